#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What `l4dtrain train --size` gains over fewer Gaussians and an encode.

usage: size_rate.py L4DTRAIN FOLDER CAPTURE --numbers N,.. --sizes SIZE,.. [--presets P,..]
                    [--seeds S,..] [--jobs J] [OPTION of `l4dtrain train`...]

Trains CAPTURE into FOLDER with each number of Gaussians and `--encode default`, and with each size
and preset, J at a time, and prints a table. The last lines are the mean differences of bytes
between the curves over the sizes and that over the numbers, on training and on test views.
"""

import argparse
import concurrent.futures
import json
import pathlib
import subprocess

import codec_rate


def train(own, name, arguments):
    """(bytes, training dB, test dB, Gaussians) of a training."""
    run = own.folder.resolve() / name
    command = [own.l4dtrain.resolve(), "train", own.capture.resolve(), "-o", run, "--force", "--quiet"]
    subprocess.run([str(c) for c in command + arguments], check=True, stdout=subprocess.DEVNULL)
    report = json.loads((run / "report.json").read_text())
    stream = report["stream"]
    return (stream["file_bytes"], stream["train"]["psnr"], stream["test"]["psnr"],
            report["gaussians"], report["train"]["psnr"], report["test"]["psnr"])


def main():
    parser = argparse.ArgumentParser(usage=__doc__.split("usage: ")[1].split("\n\n")[0],
                                     allow_abbrev=False)
    for name in ("l4dtrain", "folder", "capture"):
        parser.add_argument(name, type=pathlib.Path)
    for name in ("--numbers", "--sizes"):
        parser.add_argument(name, required=True)
    parser.add_argument("--presets", default="default")
    parser.add_argument("--seeds", default="0")
    parser.add_argument("--jobs", type=int, default=1)
    own, options = parser.parse_known_args()
    own.folder.mkdir(parents=True, exist_ok=True)
    ways = [("fewer", f"-n {n}", ["-n", n, "--encode", "default"]) for n in own.numbers.split(",")]
    ways += [(f"size, {preset}", f"--size {size} --encode {preset}",
              ["--size", size, "--encode", preset])
             for preset in own.presets.split(",") for size in own.sizes.split(",")]
    seeds = own.seeds.split(",")
    curves = {}
    print("| training | seed | Gaussians | scene, training and test | bytes | training | test |")
    print("|---|---:|---:|---:|---:|---:|---:|")
    with concurrent.futures.ThreadPoolExecutor(own.jobs) as pool:
        jobs = [(curve, text, seed, pool.submit(
            train, own, f"{text}-{seed}".replace(" ", ""), extra + ["--seed", seed] + options))
            for seed in seeds for curve, text, extra in ways]
        for curve, text, seed, job in jobs:
            size, training, test, count, *scene = job.result()
            curves.setdefault((curve, seed), []).append((size, training, test))
            print(f"| `{text}` | {seed} | {count:,} | {scene[0]:.2f}, {scene[1]:.2f} dB | {size:,} | "
                  f"{training:.2f} dB | {test:.2f} dB |", flush=True)
    print()
    for curve in dict.fromkeys(name for name, _ in curves if name != "fewer"):
        for which, views in ((1, "training"), (2, "test")):
            changes = [codec_rate.difference(curves["fewer", seed], curves[curve, seed], which)
                       for seed in seeds]
            print(f"Bytes at equal PSNR of {views} views, {curve} against fewer Gaussians: " +
                  ", ".join("no common range" if c is None else f"{c:+.1f} %" for c in changes))


if __name__ == "__main__":
    main()

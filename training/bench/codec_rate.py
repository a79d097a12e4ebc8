#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What --codec of a training does to the size of streams at equal quality.

usage: codec_rate.py L4DTRAIN L4DCODEC FOLDER CAPTURE [--modes M,..] [--presets P,..]
                     [OPTION of `l4dtrain train`...]

Trains CAPTURE with each mode into FOLDER, encodes the results with each preset, compares decoded
streams with the captured images, and prints a table. A mode is a value of --codec, and may have
options of its own: off,prune,settle (the default), or prune,prune:opacity-weight=0.03. A mode that
settles trains once for each preset, as it does so on the stream of one. The last lines are the mean
differences of bytes to the first mode, over the range of PSNR that both have, on training and on
test views.
"""

import argparse
import json
import math
import pathlib
import subprocess

PRESETS = "tiny,small,default,large"


def run(*command):
    return subprocess.run([str(c) for c in command], check=True, stdout=subprocess.PIPE).stdout


def curve_of(tools, run_folder, options, mode, presets):
    """[(bytes, train dB, test dB)] of the presets, and the report of the last one."""
    train, codec, capture = tools
    name, *own = mode.split(":")
    own = [part for option in own for part in ("--" + option).split("=", 1)]
    stream = run_folder / "scene.l4d"
    points = []
    for preset in presets:
        if name == "settle" or not points:
            run(train, "train", capture, "-o", run_folder, "--force", "--quiet", "--codec", name,
                "--encode", preset, *own, *options)
        run(codec, "encode", run_folder / "scene.ply", "--weights", run_folder / "weights.ply",
            "--preset", preset, "-o", stream, "--force", "--quiet")
        report = json.loads(run(train, "eval", run_folder, "--json", "--quiet"))
        points.append((report["stream"]["file_bytes"], report["stream"]["train"]["psnr"],
                       report["stream"]["test"]["psnr"]))
        scene = f"{report['train']['psnr']:.2f}, {report['test']['psnr']:.2f} dB"
        print(f"| {mode} | {report['gaussians']:,} | {scene} | {preset} | {points[-1][0]:,} | "
              f"{points[-1][1]:.2f} dB | {points[-1][2]:.2f} dB |", flush=True)
    return points


def log_bytes_at(points, psnr, which):
    """Of the curve, straight between its points, which rise in PSNR."""
    for a, b in zip(points, points[1:]):
        if a[which] <= psnr <= b[which]:
            share = (psnr - a[which]) / max(b[which] - a[which], 1e-12)
            return math.log(a[0]) + share * (math.log(b[0]) - math.log(a[0]))
    return None


def difference(off, on, which):
    """Mean of the relative difference of bytes in the common range, in per cent, or None."""
    # A point that costs more and shows less than another is not on the curve.
    def hull(points):
        kept = []
        for p in sorted(points):
            if not kept or p[which] > kept[-1][which]:
                kept.append(p)
        return kept

    off, on = hull(off), hull(on)
    low = max(off[0][which], on[0][which])
    high = min(off[-1][which], on[-1][which])
    if not low < high:
        return None
    steps = 200
    total = sum(log_bytes_at(on, low + (high - low) * k / steps, which)
                - log_bytes_at(off, low + (high - low) * k / steps, which)
                for k in range(1, steps))
    return 100 * (math.exp(total / (steps - 1)) - 1)


def main():
    parser = argparse.ArgumentParser(usage=__doc__.split("usage: ")[1].split("\n\n")[0],
                                     allow_abbrev=False)
    for name in ("l4dtrain", "l4dcodec", "folder", "capture"):
        parser.add_argument(name, type=pathlib.Path)
    parser.add_argument("--modes", default="off,prune,settle")
    parser.add_argument("--presets", default=PRESETS)
    own, options = parser.parse_known_args()
    modes, presets = own.modes.split(","), own.presets.split(",")
    own.folder.mkdir(parents=True, exist_ok=True)
    tools = [path.resolve() for path in (own.l4dtrain, own.l4dcodec, own.capture)]
    print("| --codec | Gaussians | scene, training and test | preset | bytes | training | test |")
    print("|---|---:|---:|---|---:|---:|---:|")
    curves = [curve_of(tools, own.folder.resolve() / mode.replace(":", "-"), options, mode, presets)
              for mode in modes]
    for mode, curve in list(zip(modes, curves))[1:]:
        texts = []
        for name, which in (("training", 1), ("test", 2)):
            change = difference(curves[0], curve, which)
            texts.append(f"{name} views " +
                         ("no common range" if change is None else f"{change:+.1f} %"))
        print(f"\nBytes at equal PSNR, {mode} against {modes[0]}: " + ", ".join(texts))


if __name__ == "__main__":
    main()

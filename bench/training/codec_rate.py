#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What --codec of a training does to the size of streams at equal quality.

usage: codec_rate.py L4DTRAIN L4DCODEC FOLDER CAPTURE [OPTION of `l4dtrain train`...]

Trains CAPTURE without and with `--codec prune`, both into FOLDER, encodes each result with four
presets, compares decoded streams with the captured images, and prints a table. The last line is the
mean difference of bytes over the range of PSNR that both have, on training and on test views.
"""

import json
import math
import pathlib
import subprocess
import sys

PRESETS = ("tiny", "small", "default", "large")


def run(*command):
    return subprocess.run([str(c) for c in command], check=True, stdout=subprocess.PIPE).stdout


def curve_of(train, codec, run_folder, capture, options, mode):
    """[(bytes, train dB, test dB)] of the presets, and the number of Gaussians."""
    run(train, "train", capture, "-o", run_folder, "--force", "--quiet", "--codec", mode,
        "--encode", "default", *options)
    stream = run_folder / "scene.l4d"
    points = []
    for preset in PRESETS:
        run(codec, "encode", run_folder / "scene.ply", "--weights", run_folder / "weights.ply",
            "--preset", preset, "-o", stream, "--force", "--quiet")
        report = json.loads(run(train, "eval", run_folder, "--json", "--quiet"))
        points.append((report["stream"]["file_bytes"], report["stream"]["train"]["psnr"],
                       report["stream"]["test"]["psnr"]))
    return points, report


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
    if len(sys.argv) < 5:
        sys.exit(__doc__)
    train, codec, folder, capture = (pathlib.Path(a).resolve() for a in sys.argv[1:5])
    options = sys.argv[5:]
    folder.mkdir(parents=True, exist_ok=True)
    curves = {}
    print("| --codec | Gaussians | scene, training and test | preset | bytes | training | test |")
    print("|---|---:|---:|---|---:|---:|---:|")
    for mode in ("off", "prune"):
        curves[mode], report = curve_of(train, codec, folder / mode, capture, options, mode)
        scene = f"{report['train']['psnr']:.2f}, {report['test']['psnr']:.2f} dB"
        for preset, (size, on_train, on_test) in zip(PRESETS, curves[mode]):
            print(f"| {mode} | {report['gaussians']:,} | {scene} | {preset} | {size:,} | "
                  f"{on_train:.2f} dB | {on_test:.2f} dB |")
    texts = []
    for name, which in (("training", 1), ("test", 2)):
        change = difference(curves["off"], curves["prune"], which)
        texts.append(f"{name} views " + ("no common range" if change is None else f"{change:+.1f} %"))
    print("\nBytes at equal PSNR, prune against off: " + ", ".join(texts))


if __name__ == "__main__":
    main()

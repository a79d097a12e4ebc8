#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What it costs to measure some views of many: seconds, and fidelity at equal bytes.

usage: subset.py TOOL SCENE --views "--cameras c.json" --compare "--cameras c.json --split all"
                 [--agreements 0.95,0.98,0.99] [--qualities 38:46] [--seeds 4] [--backend cuda]
                 [--folder build/subset] [--jobs 4]

Weights are measured from all views and from as many as each agreement takes, with several seeds;
with each the scene is encoded at several qualities. Of every file its images are compared with the
scene's, and set against the curve of bytes and decibels of all views, averaged over their seeds.
"""
import argparse
import concurrent.futures
import json
import math
import pathlib
import statistics
import subprocess
import sys


def run(tool, arguments, backend):
    command = [tool, *map(str, arguments), "--backend", backend, "--json", "--force"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        sys.exit(f"{' '.join(command)}: {done.stderr}")
    return json.loads(done.stdout)


def interpolate(curve, x):
    """Of (x, y) by rising x, the y at x, on the nearest straight line."""
    k = next((k for k in range(1, len(curve) - 1) if x < curve[k][0]), len(curve) - 1)
    (x0, y0), (x1, y1) = curve[k - 1], curve[k]
    return y0 + (y1 - y0) * (x - x0) / (x1 - x0)


class Bench:
    def __init__(self, options):
        self.o = options
        self.folder = pathlib.Path(options.folder)
        self.folder.mkdir(parents=True, exist_ok=True)
        first, last = map(int, options.qualities.split(":"))
        self.qualities = range(first, last + 1)

    def weights(self, kind, seed):
        """Measures weights; kind: an agreement or "all"."""
        path = self.folder / f"w_{kind}_{seed}.ply"
        how = ["--all-views"] if kind == "all" else ["--agreement", kind]
        return run(self.o.tool, ["sensitivity", self.o.scene, *self.o.views.split(), *how, "--seed",
                                 seed, "-o", path], self.o.backend)

    def point(self, kind, seed, quality):
        """Bytes, as a logarithm, and decibels."""
        stream = self.folder / f"{kind}_{seed}_{quality}.l4d"
        weights = self.folder / f"w_{kind}_{seed}.ply"
        encoded = run(self.o.tool, ["encode", self.o.scene, "--weights", weights, "--quality",
                                    quality, "-o", stream], "cpu")
        compared = run(self.o.tool, ["compare", self.o.scene, stream, *self.o.compare.split()],
                       self.o.backend)
        stream.unlink()
        return math.log(encoded["file_bytes"]), compared["fidelity_db"]

    def main(self):
        kinds = ["all", *self.o.agreements.split(",")]
        reports = {(k, s): self.weights(k, s) for k in kinds for s in range(self.o.seeds)}
        keys = [(k, s, q) for k in kinds for s in range(self.o.seeds) for q in self.qualities]
        with concurrent.futures.ThreadPoolExecutor(self.o.jobs) as pool:
            points = dict(zip(keys, pool.map(lambda key: self.point(*key), keys)))
        seeds = range(self.o.seeds)
        curve = [tuple(statistics.fmean(points["all", s, q][axis] for s in seeds)
                       for axis in (0, 1)) for q in self.qualities]
        print("| agreement | views measured | visibility only | s | dB at equal bytes | seeds spread (sd) |")
        print("|---|---:|---:|---:|---:|---:|")
        for kind in kinds:
            r = reports[kind, 0]
            seconds = statistics.median(reports[kind, s]["seconds"] for s in seeds)
            of_seed = [statistics.fmean(points[kind, s, q][1] - interpolate(curve, points[kind, s, q][0])
                                        for q in self.qualities) for s in seeds]
            spread = statistics.stdev(of_seed) if len(of_seed) > 1 else 0.0
            print(f"| {kind} | {r['views_measured']:,} | {r['views_visibility_only']:,} | {seconds:.2f} "
                  f"| {statistics.fmean(of_seed):+.3f} | {spread:.3f} |")


def parse():
    p = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    p.add_argument("tool")
    p.add_argument("scene")
    p.add_argument("--views", required=True, help="options of `sensitivity` that name the views")
    p.add_argument("--compare", required=True, help="options of `compare` that name the views")
    p.add_argument("--agreements", default="0.95,0.98,0.99")
    p.add_argument("--qualities", default="38:46")
    p.add_argument("--seeds", type=int, default=4)
    p.add_argument("--backend", default="cuda")
    p.add_argument("--folder", default="build/subset")
    p.add_argument("--jobs", type=int, default=4)
    return p.parse_args()


if __name__ == "__main__":
    Bench(parse()).main()

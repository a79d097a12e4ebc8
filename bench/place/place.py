#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Measures presets and effects on the market square of `synth`; writes a page.

usage: place.py L4DCODEC FOLDER PAGE.md [SIZE...]

SIZE: Gaussians of the squares that presets code (100k 500k; 4M wants some 8 GB of memory). Scenes and streams lie in
FOLDER, and are removed.
"""

import json
import os
import pathlib
import platform
import subprocess
import sys
import time

CODINGS = [(preset, ["--preset", preset]) for preset in ("tiny", "small", "default", "large", "archive")]
CODINGS += [("default `--estimate`", ["--estimate"])]
EFFECTS = ("rigid", "deform", "flicker", "drops", "view")
OF_EFFECTS = "100k"
VIEWS = ("--ids", "0-7", "--frames", "0:150:75")


class Tool:
    def __init__(self, program, folder):
        self.program, self.folder = program, folder

    def __call__(self, *arguments):
        made = subprocess.run([self.program, *map(str, arguments), "--json"], capture_output=True, text=True,
                              check=False, cwd=self.folder)
        if made.returncode != 0:
            raise SystemExit(f"l4dcodec {' '.join(map(str, arguments))}: {made.stdout}{made.stderr}")
        return json.loads(made.stdout)


def millions(size):
    return f"{size / 1e6:.2f}"


def processor_seconds(call):
    """What call returns, its wall seconds, and its seconds of all processors."""
    before, begin = os.times(), time.monotonic()
    result = call()
    after = os.times()
    used = after.children_user + after.children_system - before.children_user - before.children_system
    return result, time.monotonic() - begin, used


def presets_of(tool, size):
    made, _, used = processor_seconds(
        lambda: tool("synth", "-n", size, "--cameras-out", "cameras.json", "-o", "scene.ply", "--force"))
    rows = [f"**{made['num_gaussians']:,} Gaussians**: {millions(made['file_bytes'])} MB as PLY, made in {used:.0f} CPU s.", "",
            "| preset | MB | times smaller | bits a Gaussian | fidelity dB | worst view dB | encode CPU s | decode CPU s |",
            "|---|---:|---:|---:|---:|---:|---:|---:|"]
    for name, options in CODINGS:
        coded, _, encoding = processor_seconds(
            lambda: tool("encode", "scene.ply", *options, "-o", "scene.l4d", "--force"))
        _, _, decoding = processor_seconds(lambda: tool("decode", "scene.l4d", "--digest"))
        judged = tool("compare", "scene.ply", "scene.l4d", "--cameras", "cameras.json", *VIEWS)
        rows.append(f"| {name} | {millions(coded['file_bytes'])} | {coded['ratio']:.1f} | {coded['bits_per_gaussian']:.1f} | "
                    f"{judged['fidelity_db']:.1f} | {judged['min_fidelity_db']:.1f} | {encoding:.1f} | {decoding:.2f} |")
        print(rows[-1], file=sys.stderr)
    return rows + [""]


def effect_row(tool, effects):
    tool("synth", "-n", OF_EFFECTS, "--effects", ",".join(effects), "-o", "scene.ply", "--force")
    coded = tool("encode", "scene.ply", "-o", "scene.l4d", "--force")
    timed = [tool("decode", "scene.l4d", "--digest", "--threads", 1)["decode_s"] for _ in range(3)]
    sliced = tool("slice", "scene.l4d", "--from", 2, "--to", 3, "--fps", 30, "--digest", "--threads", 1)
    drawn = [tool("render", "scene.l4d", "--range", "2:2.4", "--size", "960x540", "-o", "%03d.png", "--force")
             for _ in range(2)]
    frames = drawn[0]["frames"]
    slicing = 1000 * min(d["passes"]["slice"] for d in drawn) / frames
    return (f"| {', '.join(effects)} | {millions(coded['file_bytes'])} | {coded['bits_per_gaussian']:.1f} | "
            f"{coded['num_layers']} | {1000 * min(timed):.0f} | {1000 * sliced['slice_s'] / sliced['num_frames']:.1f} | "
            f"{slicing:.2f} | {1000 * min(d['render_s'] for d in drawn) / frames:.1f} | {drawn[0]['visible']:,.0f} |")


def effects_of(tool):
    rows = [f"`synth -n {OF_EFFECTS} --effects LIST`, `encode`, preset `default`. All have the same number of Gaussians, so what "
            "moves has fewer for the rest. One thread decodes and slices; a slice is an instant as a player of pages makes "
            "it, with all colours; 12 pictures of 960 x 540 are rendered from the first view.", "",
            "| effects | MB | bits a Gaussian | layers | decode all, ms | slice an instant, ms | slice in the renderer, ms | "
            "render a picture, ms | visible |", "|---|---:|---:|---:|---:|---:|---:|---:|---:|"]
    for effects in [["static"], *[["static", effect] for effect in EFFECTS], ["static", *EFFECTS]]:
        rows.append(effect_row(tool, effects))
        print(rows[-1], file=sys.stderr)
    return rows + [""]


def processor():
    names = [line.split(":")[1].strip() for line in pathlib.Path("/proc/cpuinfo").read_text().splitlines()
             if line.startswith("model name")]
    return f"{names[0] if names else platform.machine()}, {os.cpu_count()} cores"


def main():
    if len(sys.argv) < 4:
        raise SystemExit(__doc__)
    folder, page = pathlib.Path(sys.argv[2]), pathlib.Path(sys.argv[3])
    sizes = sys.argv[4:] or ["100k", "500k"]
    folder.mkdir(parents=True, exist_ok=True)
    tool = Tool(pathlib.Path(sys.argv[1]).resolve(), folder)
    rows = ["# The market square", "",
            "`./dev bench place` makes this page of the scene that `l4dcodec synth` makes: its truth is known, and each thing in "
            "it is there for one effect. Fidelity is that of eight named views at two instants, none of which the "
            f"encoder knew.", "", "`synth --scene room` makes a second place of the same parts, a living room in the evening. "
            "It is closed, and its cameras stand within; lamps and a fire light it, and it has the same effects: a fan, a "
            "clock and a rocking chair turn (rigid), curtains and a cat stir (deform), fire and candles burn (flicker), rain "
            "and sparks fly (drops), and a polished ball mirrors it all (view).", "", f"Measured on: {processor()}; {os.getloadavg()[0]:.0f} programs wanted to run as it began. CPU "
            "seconds do not depend on that; milliseconds do.", "", "## Presets", ""]
    for size in sizes:
        rows += presets_of(tool, size)
    rows += ["## Effects one by one", "", *effects_of(tool)]
    for name in folder.iterdir():
        name.unlink()
    page.write_text("\n".join(rows).rstrip() + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()

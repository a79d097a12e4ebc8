#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Compares streams with other coders of points and of 3D Gaussians; writes a page.

usage: peers.py L4DCODEC FOLDER PAGE.md [SECONDS]

Packages from npm are installed into FOLDER. What is not there is left out and named, on stderr and
on the page. SECONDS: how long one conversion by a rival may take (600).
"""

import json
import os
import pathlib
import shutil
import subprocess
import sys

import frames
import means

ROOT = pathlib.Path(__file__).resolve().parents[2]
PACKAGES = ("meshoptimizer@1.3.0", "draco3d@1.5.9", "@playcanvas/splat-transform@3.7.0")
DATA = pathlib.Path(os.environ.get("L4D_DATA_DIR", ROOT.parent / "shared" / "data"))
INSTANT = "2.5"

INTRODUCTION = """\
# Against other coders

`./dev bench peers` makes this page. It installs the versions of meshoptimizer, Draco and
splat-transform named below from npm into `build/peers`, and leaves out packages that it cannot
install. Formats of moving scenes, as `.4dgs`, are not in it: npm has no writer of them.
"""


class Tool:
    """The tool under test: a call runs a verb and returns its document."""
    root = ROOT

    def __init__(self, program):
        self.program = program

    def __call__(self, *arguments):
        made = subprocess.run([self.program, *map(str, arguments), "--json"], capture_output=True,
                              text=True, check=False)
        if made.returncode != 0:
            command = " ".join(map(str, arguments))
            raise RuntimeError(f"l4dcodec {command}: {made.stdout}{made.stderr}")
        return json.loads(made.stdout)


def install(folder, packages=PACKAGES):
    """True where the packages are there afterwards."""
    if not shutil.which("npm") or not shutil.which("node"):
        return False
    (folder / "package.json").write_text('{"private": true}\n', encoding="utf-8")
    made = subprocess.run(["npm", "install", "--no-audit", "--no-fund", "--silent", *packages],
                          cwd=folder, check=False)
    return made.returncode == 0


def scenes_of(tool, folder, transform):
    """Names and 3DGS PLY files."""
    out = []
    dynamic = DATA / "basketball" / "basketball.ply"
    if dynamic.exists():
        frame = folder / "basketball.ply"
        tool("slice", dynamic, "--time", INSTANT, "-o", frame, "-f")
        out.append(("basketball", frame))
        if transform:
            flat = folder / "basketball_flat.ply"
            subprocess.run([*transform, "-q", "-w", str(frame), "-H", "0", str(flat)], check=True,
                           capture_output=True)
            out.append(("basketball, SH degree 0", flat))
    for path in sorted((DATA / "statues").glob("*.ply")):
        out.append((path.stem, path))
    return [(name.replace(" ", "_").replace(",", ""), path) for name, path in out]


def means_chapter(rows):
    own = rows[0]["bytes"]
    lines = ["| coder | bytes | bits a point | of ours |", "|---|---:|---:|---:|"]
    lines += [f"| {r['name']} | {r['bytes']:,} | {r['bits']:.2f} | {r['bytes'] / own:.2f} |"
              for r in rows]
    return ["## Positions", "",
            "The table codes the positions of the basketball scene as a stream of the preset "
            "`indexed` stores them: binary16 around the median, as 16-bit integers in the order of "
            "their values. No coder loses anything further. The other coders code all positions as "
            "one sorted set. The stream codes independent pages, by layers and time buckets; the "
            "second row is the stream with one layer and without time buckets. The entropy tables "
            f"of the stream, for all columns, take another {rows[0]['tables']:,} bytes.", "",
            *lines, ""]


def cell(row, against):
    if row is None:
        return "none as good | | "
    return (f"{row['name']} {row['bytes']:,} | {row['fidelity_db']:.2f} | "
            f"{row['bytes'] / against * 100:.0f} %")


def frames_chapter(compared, every):
    lines = ["## Static scenes", "",
             "`splat-transform` converts a PLY of 3D Gaussians into each format and back. The "
             "stream uses the smallest of a few settings whose fidelity is no lower. Fidelity is "
             "the PSNR of renders of 16 cameras around the scene. The first columns of ours are "
             "without weights. The second ones use weights measured from 23 other cameras, from "
             "which some Gaussians contribute little or nothing; the other formats use no views. "
             f"\"basketball\" is the dynamic scene at {INSTANT} s.", "",
             "| scene | format | bytes | dB | ours, no views | dB | of its bytes | ours, measured | "
             "dB | of its bytes |",
             "|---|---|---:|---:|---:|---:|---:|---:|---:|---:|"]
    for row in compared:
        lines.append(f"| {row['scene'].replace('_', ' ')} | {row['name']} | {row['bytes']:,} | "
                     f"{row['fidelity_db']:.2f} | {cell(row['plain'], row['bytes'])} | "
                     f"{cell(row['measured'], row['bytes'])} |")
    lines += ["", "All streams:", "", "| scene | preset | weights | bytes | dB |",
              "|---|---|---|---:|---:|"]
    lines += [f"| {r['scene'].replace('_', ' ')} | {r['name']} | "
              f"{'measured' if r['measured'] else 'none'} | {r['bytes']:,} | "
              f"{r['fidelity_db']:.2f} |" for r in every]
    return lines + [""]


def main(arguments):
    if len(arguments) not in (3, 4):
        print(__doc__.strip())
        return 2
    tool, folder, page = Tool(arguments[0]), pathlib.Path(arguments[1]), pathlib.Path(arguments[2])
    limit = float(arguments[3]) if len(arguments) == 4 else 600.0
    folder.mkdir(parents=True, exist_ok=True)
    skipped = []

    def skip(text):
        skipped.append(text)
        print(f"peers: skipped: {text}", file=sys.stderr)

    has = {"zstd"} if shutil.which("zstd") else set()
    transform = None
    if install(folder):
        has.add("packages")
        transform = [str(folder / "node_modules" / ".bin" / "splat-transform")]
    else:
        skip("npm or its packages are not there: no meshoptimizer, Draco, SPZ, SOG, compressed PLY")
    parts = [INTRODUCTION, "Packages: " + ", ".join(PACKAGES) + ".\n"]
    scene = DATA / "basketball" / "basketball.ply"
    if scene.exists():
        parts += means_chapter(means.table(tool, scene, folder, has, skip))
    else:
        skip(f"{scene} is not there: no table of positions")
    scenes = scenes_of(tool, folder, transform)
    if scenes:
        parts += frames_chapter(*frames.table(tool, transform, scenes, folder, limit, skip))
    else:
        skip(f"no scenes in {DATA}: no table of static scenes")
    if skipped:
        parts += ["Left out:", ""] + [f"* {text}" for text in skipped]
    page.write_text("\n".join(parts).rstrip("\n") + "\n", encoding="utf-8")
    print(page)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Points of each part of a sequence, for `l4dtrain train --init FOLDER`, from a scene that is known.

usage: instant_points.py SCENE.ply FOLDER [--every SECONDS]

FOLDER gets a PLY for the frame in the middle of each part, with a point for each Gaussian of SCENE
(l4d_ply 1, as `l4dcodec synth` writes it) whose mean time lies in the part, in its base colour."""

import argparse
import array
import collections
import pathlib
import sys

DC = 0.28209479177387814
HEADER = """ply
format binary_little_endian 1.0
element vertex {}
property float x
property float y
property float z
property uchar red
property uchar green
property uchar blue
end_header
"""


def read_scene(path):
    """Numbers of the comments by name; columns by name."""
    data = path.read_bytes()
    end = data.index(b"end_header\n") + len(b"end_header\n")
    words = [line.split() for line in data[:end].decode("ascii").splitlines()]
    said = {w[1]: w[2] for w in words if w[0] == "comment" and len(w) == 3}
    names = [w[2] for w in words if w[:2] == ["property", "float"]]
    rows = array.array("f", data[end:])
    if sys.byteorder == "big":
        rows.byteswap()
    return said, {name: rows[k::len(names)] for k, name in enumerate(names)}


def main():
    parser = argparse.ArgumentParser(description="Points of each part of a sequence")
    parser.add_argument("scene", type=pathlib.Path)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--every", type=float, default=1, help="seconds of a part")
    options = parser.parse_args()
    said, columns = read_scene(options.scene)
    begin, fps = float(said["time_begin"]), float(said["fps"])
    last = int((float(said["time_end"]) - begin) * fps) - 1
    parts = collections.defaultdict(bytearray)
    of_part = collections.Counter()
    for i, time in enumerate(columns["t"]):
        middle = (int((time - begin) / options.every) + 0.5) * options.every
        frame = min(max(int(middle * fps), 0), last)
        colours = [max(0.0, min(1.0, 0.5 + DC * columns[f"f_dc_{c}"][i])) for c in range(3)]
        parts[frame] += array.array("f", [columns[axis][i] for axis in "xyz"]).tobytes()
        parts[frame] += bytes(round(255 * c) for c in colours)
        of_part[frame] += 1
    options.folder.mkdir(parents=True, exist_ok=True)
    for frame, points in parts.items():
        header = HEADER.format(of_part[frame]).encode("ascii")
        (options.folder / f"{frame:06d}.ply").write_bytes(header + points)
    print(f"{len(columns['t'])} points of {len(parts)} instants")


if __name__ == "__main__":
    main()

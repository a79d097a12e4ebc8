#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Makes cameras of a capture wrong, for `l4dtrain train --refine-times` and `--refine-cameras`.

usage: wrong_cameras.py CAMERAS.json OUT.json [--late ID=SECONDS] [--yaw ID=DEGREES]
                        [--pitch ID=DEGREES] [--focal ID=FACTOR]

OUT.json is CAMERAS.json where the clock of a camera is so much later, it is turned about its own
vertical (yaw) or horizontal axis (pitch), or has so many times its focal length. Each option may
be there several times. OUT.json belongs beside CAMERAS.json, whose images it names."""

import argparse
import json
import math
import pathlib


def turned(w2c, degrees, first, second):
    """Rows of world to camera, of which two turn towards each other."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    out = [list(row) for row in w2c]
    out[first] = [c * a + s * b for a, b in zip(w2c[first], w2c[second])]
    out[second] = [c * b - s * a for a, b in zip(w2c[first], w2c[second])]
    return out


def main():
    parser = argparse.ArgumentParser(description="Makes cameras of a capture wrong")
    parser.add_argument("cameras", type=pathlib.Path)
    parser.add_argument("out", type=pathlib.Path)
    for option in ("late", "yaw", "pitch", "focal"):
        parser.add_argument(f"--{option}", action="append", default=[], metavar="ID=NUMBER")
    options = parser.parse_args()
    document = json.loads(options.cameras.read_text(encoding="utf-8"))
    cameras = {camera["id"]: camera for camera in document["cameras"]}
    for option in ("late", "yaw", "pitch", "focal"):
        for text in getattr(options, option):
            name, _, number = text.partition("=")
            camera, by = cameras[int(name)], float(number)
            if option == "late":
                camera["time_offset"] = camera.get("time_offset", 0) + by
            elif option == "focal":
                for k in (0, 1):
                    camera["K"][k][k] *= by
            else:
                camera["w2c"] = turned(camera["w2c"], by, *((0, 2) if option == "yaw" else (2, 1)))
    options.out.write_text(json.dumps(document) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()

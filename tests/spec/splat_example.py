#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The worked example of compositing: appendix H of spec/l4d.md and splat.l4d, one Gaussian.

  splat_example.py --write    writes the stream, and what the appendix shows of it
"""

import sys

import raw_scene
import rans_examples
import splats
from splats import Camera

FILE = rans_examples.FOLDER / "splat.l4d"
GAUSSIAN = {"position": [0.5, -0.25, 3.0], "mean_t": [0.25], "opacity": [0.75],
            "sh": [1.0, 0.5, -0.25, 0.25, 0.125, -0.5, -0.125, 0.5, 0.25, 0.375, -0.25, 0.125],
            "log_scale": [-2.0, -1.0, -1.5, -1.0],
            "rotor": [1.0, 0.25, 0.125, 0.5, 0.25, -0.125, 0.5, 0.0]}
CAMERA = Camera(16, 12, (20.0, 22.0), (8.0, 6.0),
                [[0.8, 0.0, -0.6], [0.0, 1.0, 0.0], [0.6, 0.0, 0.8]], [1.5, 0.25, 0.5])
TIME, PIXEL, BACKGROUND = 0.5, (9, 4), [0.25, 0.5, 0.0]


def numbers(values):
    return "  ".join(f"{v:.9f}" for v in values)


def data():
    return raw_scene.stream([GAUSSIAN])


def computed():
    """The slice, the splat and its alpha at the pixel."""
    slice_ = splats.sliced(GAUSSIAN, TIME, GAUSSIAN["mean_t"][0])
    splat = splats.splat(slice_, GAUSSIAN["sh"], CAMERA)
    return slice_, splat, splats.alpha_at(splat, *PIXEL)


def image():
    """[r, g, b, alpha] of each pixel."""
    slice_ = splats.sliced(GAUSSIAN, TIME, GAUSSIAN["mean_t"][0])
    return splats.image([slice_], [GAUSSIAN["sh"]], CAMERA, BACKGROUND)


def example():
    s, p, (dx, dy, q, alpha) = computed()
    rgb = splats.pixel([p], *PIXEL, BACKGROUND)[:3]
    matrix = lambda m: [m[0][0], m[0][1], m[1][1]]
    return ["```",
            *[f"{name:<12} {'  '.join(f'{v:g}' for v in row)}" for name, row in GAUSSIAN.items()], "",
            "                       section 16",
            f"lambda                 {s['lambda']:.9f}",
            f"v                      {numbers(s['v'])}",
            *[f"{'covariance' if i == 0 else '':<22} {numbers(row)}"
              for i, row in enumerate(s["covariance"])],
            f"centre                 {numbers(s['centre'])}",
            f"opacity at the time    {s['opacity']:.9f}", "",
            "                       steps 2 to 4",
            f"camera axes            {numbers(p['camera'])}",
            f"sx, sy                 {numbers(p['slope'])}",
            *[f"{'J' if i == 0 else '':<22} {numbers(row)}" for i, row in enumerate(p["J"])],
            f"covariance xx xy yy    {numbers(matrix(p['undilated']))}",
            f"  with 0.3 added       {numbers(matrix(p['covariance']))}",
            f"mean                   {numbers(p['mean'])}", "",
            "                       step 5",
            f"d                      {numbers(p['direction'])}",
            f"colour                 {numbers(p['colour'])}", "",
            "                       steps 6 and 7",
            f"dx, dy                 {numbers((dx, dy))}", f"q                      {q:.9f}",
            f"alpha                  {alpha:.9f}",
            f"pixel                  {numbers(rgb)}",
            f"pixel in 8 bits        {'  '.join(str(to_byte(v)) for v in rgb)}", "```"]


def to_byte(v):
    return int(min(max(v, 0.0), 1.0) * 255 + 0.5)


def write():
    FILE.write_bytes(data())
    text = rans_examples.SPEC.read_text(encoding="utf-8")
    begin, end = shown(text)
    rans_examples.SPEC.write_text(text[:begin] + "\n".join(example()) + "\n" + text[end:],
                                  encoding="utf-8")


def shown(text):
    begin = "<!-- splat: written by tests/spec/splat_example.py -->\n"
    return text.index(begin) + len(begin), text.index("<!-- end of splat -->")


if __name__ == "__main__":
    if sys.argv[1:] != ["--write"]:
        sys.exit(__doc__)
    write()

#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Appendix H of spec/l4d.md against its generator and the renderer:
splat_example_test.py TOOL RENDER_PIXELS"""

import json
import random
import struct
import subprocess
import sys
import tempfile
import unittest
import zlib
from pathlib import Path

sys.dont_write_bytecode = True

import raw_scene
import splat_example as example
import decode_tiny
import splats
from raw_scene import f32

PROGRAMS = {}


def read_png(data):
    """Rows of 8-bit RGB, as flat lists."""
    at, parts = 8, {}
    while at < len(data):
        size, kind = struct.unpack_from(">I4s", data, at)
        parts[kind] = parts.get(kind, b"") + data[at + 8:at + 8 + size]
        at += 12 + size
    width, height, depth, form, _, _, interlace = struct.unpack(">IIBBBBB", parts[b"IHDR"])
    assert (depth, form, interlace) == (8, 2, 0)
    raw, rows, above = zlib.decompress(parts[b"IDAT"]), [], [0] * 3 * width
    for y in range(height):
        kind, line = raw[y * (3 * width + 1)], list(raw[y * (3 * width + 1) + 1:(y + 1) * (3 * width + 1)])
        for i in range(3 * width):
            a, b, c = (line[i - 3], above[i], above[i - 3]) if i >= 3 else (0, above[i], 0)
            paeth = min((a, b, c), key=lambda v: abs(a + b - c - v))
            line[i] = line[i] + (0, a, b, (a + b) // 2, paeth)[kind] & 0xFF
        rows.append(line)
        above = line
    return rows


def rendered(path, camera, time, background):
    """[r, g, b, alpha] of each pixel, by the reference path of the library."""
    out = subprocess.run([PROGRAMS["render_pixels"], path, repr(time), ",".join(map(repr, background))],
                         input=camera.text(), capture_output=True, text=True, check=True).stdout
    return [list(map(float, line.split())) for line in out.splitlines()]


class WorkedExample(unittest.TestCase):
    def test_file_and_text_are_what_the_generator_makes(self):
        self.assertEqual(example.FILE.read_bytes(), example.data())
        text = example.rans_examples.SPEC.read_text(encoding="utf-8")
        begin, end = example.shown(text)
        self.assertEqual(text[begin:end], "\n".join(example.example()) + "\n",
                         "run splat_example.py --write")

    def test_the_text_has_the_camera(self):
        text = " ".join(example.rans_examples.SPEC.read_text(encoding="utf-8").split())
        c = example.CAMERA
        for wanted in (f"W = {c.width}, H = {c.height}, fx = {c.f[0]:g}, fy = {c.f[1]:g}, cx = {c.c[0]:g}, "
                       f"cy = {c.c[1]:g}", f"instant is {example.TIME:g} s",
                       "T = (" + ", ".join(f"{v:g}" for v in c.translation) + ")",
                       "background is (" + ", ".join(f"{v:g}" for v in example.BACKGROUND) + ")",
                       "centre at (" + ", ".join(f"{v + 0.5:g}" for v in example.PIXEL) + ")",
                       *["(" + ", ".join(f"{v:g}" for v in row) + ")" for row in c.rotation]):
            self.assertIn(wanted, text)

    def test_the_stream_holds_the_attributes(self):
        _, (gaussian,) = decode_tiny.decode(example.data())
        for name, values in example.GAUSSIAN.items():
            self.assertEqual(list(gaussian[name]), values, name)

    def test_the_library_shows_the_same_pixels(self):
        got = rendered(example.FILE, example.CAMERA, example.TIME, example.BACKGROUND)
        for a, b in zip(got, example.image(), strict=True):
            for x, y in zip(a, b, strict=True):
                self.assertLess(abs(x - y), 2e-6)

    def test_the_tool_writes_the_same_png(self):
        want = [[v for rgba in example.image()[16 * y:16 * y + 16] for v in rgba[:3]] for y in range(12)]
        c = example.CAMERA
        rows = [[*row, t] for row, t in zip(c.rotation, c.translation)] + [[0, 0, 0, 1]]
        camera = {"id": 0, "width": c.width, "height": c.height, "w2c": rows,
                  "K": [[c.f[0], 0, c.c[0]], [0, c.f[1], c.c[1]], [0, 0, 1]]}
        for path in ("fast", "reference"):
            with tempfile.TemporaryDirectory() as folder:
                Path(folder, "cameras.json").write_text(json.dumps({"cameras": [camera]}), "utf-8")
                subprocess.run([PROGRAMS["tool"], "render", example.FILE, "-o", f"{folder}/x.png",
                                "--cameras", f"{folder}/cameras.json", "--time", repr(example.TIME),
                                "--background", ",".join(map(repr, example.BACKGROUND)),
                                "--path", path, "-q"], check=True)
                got = read_png(Path(folder, "x.png").read_bytes())
            worst = max(abs(a - 255 * b) for row, line in zip(got, want, strict=True)
                        for a, b in zip(row, line, strict=True))
            self.assertLess(worst, 1, path)
            x, y = example.PIXEL
            shown = " ".join(map(str, got[y][3 * x:3 * x + 3]))
            self.assertIn(f"pixel in 8 bits {shown} ```",
                          " ".join(" ".join(example.example()).split()), path)


class Rules(unittest.TestCase):
    """Scenes in which each rule of the appendix decides about pixels."""

    CAMERA = splats.Camera(24, 18, (20.0, 24.0), (11.0, 8.0),
                           [[1.0, 0.0, 0.0], [0.0, 0.6, -0.8], [0.0, 0.8, 0.6]], [0.125, 0.5, 4.0])

    def scene(self, seed):
        rng = random.Random(seed)
        def gaussian():
            return {"position": [f32(rng.uniform(-4, 4)) for _ in range(3)],
                    "mean_t": [f32(rng.uniform(-0.2, 1.2))],
                    "opacity": [f32(rng.choice([rng.uniform(0, 0.02), rng.random(), 1.0]))],
                    "sh": [f32(rng.gauss(0, 0.6)) for _ in range(48)],
                    "log_scale": [f32(rng.uniform(-3.5, 0)) for _ in range(3)] + [f32(rng.uniform(-3, 2))],
                    "rotor": [f32(rng.gauss(0, 1)) for _ in range(8)]}
        # Large and near ones too: they end pixels.
        return [gaussian() for _ in range(60)] + [
            dict(gaussian(), opacity=[1.0], log_scale=[0.75, 0.5, 0.0, 3.0]) for _ in range(6)]

    def shown(self, gaussians, t):
        """(slice, SH) of what is visible."""
        for g in gaussians:
            mean = g["mean_t"][0]
            s = splats.sliced(g, t, min(max(mean, 0.0), 1.0))
            if s["lambda"] * (t - mean) ** 2 <= 16:
                yield s, g["sh"]

    def compare(self, gaussians, t, how, rendering):
        """Returns the picture."""
        background = [0.25, 0.0, 0.75]
        want = splats.image(*zip(*self.shown(gaussians, t)), self.CAMERA, background, how)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "scene.l4d")
            path.write_bytes(raw_scene.stream(gaussians, **rendering))
            got = rendered(path, self.CAMERA, t, background)
        errors = sorted(max(abs(x - y) for x, y in zip(a, b, strict=True))
                        for a, b in zip(got, want, strict=True))
        self.assertLess(errors[-3], 1e-5)                 # but for pixels at a step
        self.assertLess(errors[-1], 0.02 if how.min_alpha < 0.01 else 0.1)
        return want

    def test_random_scenes(self):
        t, counts = 0.375, [0] * 6
        for seed in range(6):
            gaussians = self.scene(seed)
            shown = list(self.shown(gaussians, t))
            counts[0] += len(gaussians) - len(shown)
            for s, sh in shown:
                p = splats.splat(s, sh, self.CAMERA)
                counts[1] += p is None
                if p is not None:
                    x, y, z = p["camera"]
                    counts[2] += [x / z, y / z] != p["slope"]
                    counts[3] += 0.0 in p["colour"]
                    counts[4] += splats.alpha_at(p, int(p["mean"][0]), int(p["mean"][1]))[3] == 0.999
            counts[5] += sum(p[3] > 0.999 for p in self.compare(gaussians, t, splats.DEFAULT, {}))
        self.assertGreater(min(counts), 0, counts)

    def test_what_the_header_states(self):
        gaussians = self.scene(7)
        default = self.compare(gaussians, 0.375, splats.DEFAULT, {})
        for fields in ({"dilation": 0.0}, {"dilation": 2.5}, {"cutoff": 1.5}, {"min_alpha": 0.0625},
                       {"max_alpha": 0.75}, {"compensation": True},
                       {"dilation": 1.0, "cutoff": 2.0, "min_alpha": 0.03125, "max_alpha": 0.875,
                        "compensation": True}):
            with self.subTest(fields):
                how = splats.Rendering(**{k: f32(v) for k, v in fields.items()})
                picture = self.compare(gaussians, 0.375, how, {"rendering": fields})
                self.assertNotEqual(picture, default)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    PROGRAMS["tool"], PROGRAMS["render_pixels"] = sys.argv[1:]
    unittest.main(argv=sys.argv[:1])

#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Appendix I of spec/l4d.md: a scene and a camera in other axes give the same picture.

axes_test.py RENDER_PIXELS"""

import math
import random
import re
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

sys.dont_write_bytecode = True

import axes                     # its import makes the following ones possible
import raw_scene
import splats
from raw_scene import f32
from splats import Camera, apply, product, transposed

PROGRAMS = {}
TIME, BACKGROUND = 0.375, "0.25,0.0,0.75"
TEXT = axes.rans_examples.SPEC.read_text(encoding="utf-8").split("## Appendix I.")[1].split("\n## ")[0]


def unit_quaternion(rng):
    g = [rng.gauss(0, 1) for _ in range(4)]
    return [v / math.sqrt(splats.dot(g, g)) for v in g]


def scene(degree, seed=1):
    """Large, bright, moving Gaussians before the camera."""
    rng = random.Random(seed)
    return [{"position": [rng.uniform(-2, 2), rng.uniform(-2, 2), rng.uniform(2, 6)],
             "mean_t": [f32(rng.uniform(0, 1))], "opacity": [f32(rng.uniform(0.2, 0.9))],
             "sh": [rng.gauss(0, 0.5) for _ in range(3 * (degree + 1) ** 2)],
             "log_scale": [f32(rng.uniform(-2, 0)) for _ in range(3)] + [f32(rng.uniform(-2, 1))],
             "rotor": [rng.gauss(0, 1) for _ in range(8)]} for _ in range(40)]


CAMERA = Camera(32, 24, (26.0, 30.0), (14.0, 13.0),
                [[0.8, 0.0, -0.6], [0.0, 1.0, 0.0], [0.6, 0.0, 0.8]], [1.5, 0.25, 0.5])


def picture(gaussians, camera):
    """Rows of [r, g, b, alpha]; the attributes are rounded to binary32."""
    rounded = [{name: [f32(v) for v in row] for name, row in g.items()} for g in gaussians]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "scene.l4d")
        path.write_bytes(raw_scene.stream(rounded))
        out = subprocess.run([PROGRAMS["render_pixels"], path, repr(TIME), BACKGROUND],
                             input=camera.text(), capture_output=True, text=True, check=True).stdout
    pixels = [list(map(float, line.split())) for line in out.splitlines()]
    return [pixels[y * camera.width:(y + 1) * camera.width] for y in range(camera.height)]


def turned_camera(q, camera):
    return Camera(camera.width, camera.height, camera.f, camera.c,
                  product(camera.rotation, transposed(q)), camera.translation)


def mirrored_camera(axis, camera):
    left_right = axes.mirror_matrix(0)
    return Camera(camera.width, camera.height, camera.f, (camera.width - camera.c[0], camera.c[1]),
                  product(product(left_right, camera.rotation), axes.mirror_matrix(axis)),
                  apply(left_right, camera.translation))


class Pictures(unittest.TestCase):
    def compare(self, got, want):
        """But for pixels of which the alpha of a Gaussian is at a limit."""
        errors = sorted(max(abs(a - b) for a, b in zip(x, y, strict=True))
                        for rows in zip(got, want, strict=True)
                        for x, y in zip(*rows, strict=True))
        self.assertLess(errors[-5], 1e-4)
        self.assertLess(errors[-1], 0.02)

    def test_scene_and_camera_turned(self):
        rng = random.Random(2)
        for degree in range(4):
            gaussians, g = scene(degree), unit_quaternion(rng)
            want = picture(gaussians, CAMERA)
            self.assertGreater(sum(p[3] > 0.3 for row in want for p in row), 200)
            q = axes.rotation_matrix(g)
            self.compare(picture([axes.turned(g, x) for x in gaussians], turned_camera(q, CAMERA)), want)

    def test_scene_and_camera_mirrored(self):
        for degree, axis in ((1, 0), (2, 1), (3, 0), (3, 1), (3, 2)):
            gaussians = scene(degree)
            want = [row[::-1] for row in picture(gaussians, CAMERA)]
            self.compare(picture([axes.mirrored(axis, x) for x in gaussians],
                                 mirrored_camera(axis, CAMERA)), want)

    def test_every_attribute_counts(self):
        """What is left unturned shows: the comparison is sharp enough."""
        gaussians, g = scene(3), unit_quaternion(random.Random(3))
        want, camera = picture(gaussians, CAMERA), turned_camera(axes.rotation_matrix(g), CAMERA)
        for name in ("position", "rotor", "sh"):
            part = [dict(axes.turned(g, x), **{name: x[name]}) for x in gaussians]
            with self.subTest(name), self.assertRaises(AssertionError):
                self.compare(picture(part, camera), want)


class Formulas(unittest.TestCase):
    def close(self, a, b):
        for x, y in zip(a, b, strict=True):
            if isinstance(x, list):
                self.close(x, y)
            else:
                self.assertAlmostEqual(x, y, 9)

    def test_rotations(self):
        rng = random.Random(4)
        for _ in range(20):
            g, (x, *_) = unit_quaternion(rng), scene(3, rng.random())
            q, y = axes.rotation_matrix(g), axes.turned(g, x)
            whole = [[*row, 0.0] for row in q] + [[0.0, 0.0, 0.0, 1.0]]
            self.close(splats.rotation_of(y["rotor"]), product(whole, splats.rotation_of(x["rotor"])))
            old, new = splats.sliced(x, TIME, 0.5), splats.sliced(y, TIME, 0.5)
            self.close(new["v"], apply(q, old["v"]))
            self.close(new["centre"], apply(q, old["centre"]))
            self.close(new["covariance"], product(product(q, old["covariance"]), transposed(q)))
            d = unit_quaternion(rng)[:3]
            d = [v / math.sqrt(splats.dot(d, d)) for v in d]
            self.close(splats.colour(y["sh"], apply(q, d)), splats.colour(x["sh"], d))
            k = x["sh"][3:12:3]
            vector = apply(q, [k[2], k[0], -k[1]])
            self.close(y["sh"][3:12:3], [vector[1], -vector[2], vector[0]])

    def test_a_quaternion_is_a_rotor(self):
        g = unit_quaternion(random.Random(5))
        w, x, y, z = g
        m = splats.rotation_of([w, -z, y, -x, 0, 0, 0, 0])
        self.close([row[:3] for row in m[:3]], axes.rotation_matrix(g))

    def test_mirrors(self):
        for axis in range(3):
            x, *_ = scene(3, axis)
            y, f = axes.mirrored(axis, x), axes.mirror_matrix(axis)
            old, new = splats.sliced(x, TIME, 0.5), splats.sliced(y, TIME, 0.5)
            self.close(new["v"], apply(f, old["v"]))
            self.close(new["covariance"], product(product(f, old["covariance"]), f))

    def test_tables_are_what_the_generator_makes(self):
        whole = axes.rans_examples.SPEC.read_text(encoding="utf-8")
        for name, make in axes.PARTS.items():
            begin, end = axes.shown(whole, name)
            self.assertEqual(whole[begin:end], "\n".join(make()) + "\n", "run axes.py --write")

    def test_the_table_of_sources(self):
        """Mirror and rotation of each row give its column of new axes, which point as they are meant to."""
        point = dict(zip("xyz", (1.0, 2.0, 3.0)))
        target = {"right": [1, 0, 0], "up": [0, 1, 0], "forward": [0, 0, -1], "down": [0, -1, 0]}
        rows = [[c.strip() for c in line.split("|")[1:-1]] for line in TEXT.splitlines()
                if re.search(r"(right|left)[-_](handed|down)", line) and line.startswith("|")]
        self.assertEqual(len(rows), 4)
        for source, old, new, mirror, g in rows:
            g = [float(v.replace("h", repr(axes.H))) if v != "-h" else -axes.H
                 for v in g.split(",")[0].split()]
            matrix = axes.rotation_matrix(g)
            if mirror != "-":
                matrix = product(matrix, axes.mirror_matrix("xyz".index(mirror)))
            wanted = [-point[v[1]] if v[0] == "-" else point[v] for v in new.split()]
            self.close(apply(matrix, [1.0, 2.0, 3.0]), wanted)
            for k, name in enumerate(old.split(", ")):
                self.close(apply(matrix, [float(i == k) for i in range(3)]),
                           [float(v) for v in target[name]])
            self.assertEqual("left" in source, mirror != "-", source)


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    PROGRAMS["render_pixels"] = sys.argv[1]
    unittest.main(argv=sys.argv[:1])

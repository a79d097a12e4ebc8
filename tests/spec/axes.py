#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Gaussians in other axes: the formulas of appendix I of spec/l4d.md.

  axes.py --write    writes the tables of SH into the appendix
"""

import math
import random
import sys

import rans_examples
from splats import apply, basis, dot, product, transposed

H = math.sqrt(0.5)
Y_UP_OF_Z_UP = [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]
# Rotor coefficients that a mirror at x, y or z negates: p, and those of channels with the axis.
NAMES = ("s", "b01", "b02", "b12", "b03", "b13", "b23", "p")


def rotation_matrix(g):
    w, x, y, z = g
    return [[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]]


def left_multiplied(g, v):
    """The quaternion g v."""
    w, x, y, z = g
    return [w * v[0] - x * v[1] - y * v[2] - z * v[3], w * v[1] + x * v[0] + y * v[3] - z * v[2],
            w * v[2] - x * v[3] + y * v[0] + z * v[1], w * v[3] + x * v[2] - y * v[1] + z * v[0]]


def turned_rotor(g, rotor):
    s, b01, b02, b12, b03, b13, b23, p = rotor
    s, x, y, z = left_multiplied(g, [s, -b12, b02, -b01])
    p, b03, b13, b23 = left_multiplied(g, [p, b03, b13, b23])
    return [s, -z, y, -x, b03, b13, b23, p]


def mirrored_rotor(axis, rotor):
    return [-v if name == "p" or str(axis) in name else v for name, v in zip(NAMES, rotor)]


def mirror_matrix(axis):
    return [[(-1.0 if i == axis else 1.0) * (i == j) for j in range(3)] for i in range(3)]


# ---- SH ------------------------------------------------------------------------------------------

def solved(matrix, right):
    """X of matrix X = right, by elimination."""
    n = len(matrix)
    rows = [list(a) + list(b) for a, b in zip(matrix, right)]
    for k in range(n):
        best = max(range(k, n), key=lambda i: abs(rows[i][k]))
        rows[k], rows[best] = rows[best], rows[k]
        rows[k] = [v / rows[k][k] for v in rows[k]]
        for i in range(n):
            if i != k:
                rows[i] = [a - rows[i][k] * b for a, b in zip(rows[i], rows[k])]
    return [row[n:] for row in rows]


def sh_matrix(q, degree):
    """D of one degree: coefficients in the new axes are D times those in the old ones. q: [3, 3],
    orthogonal."""
    rng = random.Random(degree)
    directions = []
    for _ in range(2 * degree + 1):
        d = [rng.gauss(0, 1) for _ in range(3)]
        directions.append([x / math.sqrt(dot(d, d)) for x in d])
    part = slice(degree ** 2, (degree + 1) ** 2)
    new = [basis(d, 3)[part] for d in directions]
    old = [basis(apply(transposed(q), d), 3)[part] for d in directions]
    return solved(new, old)


def turned_sh(q, sh):
    out = []
    for degree in range(math.isqrt(len(sh) // 3)):
        for row in sh_matrix(q, degree):
            first = 3 * degree ** 2
            out += [dot(row, sh[first + c:first + 3 * len(row):3]) for c in range(3)]
    return out


# ---- Gaussians -----------------------------------------------------------------------------------

def turned(g, gaussian):
    """By the rotation of a unit quaternion."""
    q = rotation_matrix(g)
    return dict(gaussian, position=apply(q, gaussian["position"]), sh=turned_sh(q, gaussian["sh"]),
                rotor=turned_rotor(g, gaussian["rotor"]))


def mirrored(axis, gaussian):
    m = mirror_matrix(axis)
    return dict(gaussian, position=apply(m, gaussian["position"]), sh=turned_sh(m, gaussian["sh"]),
                rotor=mirrored_rotor(axis, gaussian["rotor"]))


# ---- what the appendix shows ---------------------------------------------------------------------

def sum_text(row, first):
    """A row of D as a sum, with square roots where they are."""
    terms = []
    for k, v in enumerate(row):
        if abs(v) < 1e-9:
            continue
        square = v * v * 16
        assert abs(square - round(square)) < 1e-9
        n = round(square)
        root = math.isqrt(n)
        number = f"{root / 4:g}" if root * root == n else f"sqrt({n}) / 4"
        terms.append(("-" if v < 0 else "+") + " " + ("" if number == "1" else number + " ") +
                     f"k{first + k}")
    text = " ".join(terms)
    return text[2:] if text[0] == "+" else "-" + text[2:]


def z_up_table():
    lines = ["```"]
    for degree in range(1, 4):
        first = degree ** 2
        for k, row in enumerate(sh_matrix(Y_UP_OF_Z_UP, degree)):
            lines.append(f"k{first + k}' = {sum_text(row, first)}")
    return [*lines, "```"]


def mirror_table():
    lines = ["| mirror at | negated numbers of rotors | negated coefficients of SH |", "|---|---|---|"]
    for axis in range(3):
        rotor = [n for n, v in zip(NAMES, mirrored_rotor(axis, [1] * 8)) if v < 0]
        negated = []
        for degree in range(4):
            for k, row in enumerate(sh_matrix(mirror_matrix(axis), degree)):
                assert all(abs(abs(v) - (i == k)) < 1e-9 for i, v in enumerate(row))
                negated += [str(degree ** 2 + k)] * (row[k] < 0)
        lines.append(f"| {'xyz'[axis]} | {' '.join(rotor)} | {' '.join(negated)} |")
    return lines


PARTS = {"z-up": z_up_table, "mirrors": mirror_table}


def shown(text, name):
    begin = f"<!-- {name}: written by tests/spec/axes.py -->\n"
    return text.index(begin) + len(begin), text.index(f"<!-- end of {name} -->")


def write():
    text = rans_examples.SPEC.read_text(encoding="utf-8")
    for name, make in PARTS.items():
        begin, end = shown(text, name)
        text = text[:begin] + "\n".join(make()) + "\n" + text[end:]
    rans_examples.SPEC.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    if sys.argv[1:] != ["--write"]:
        sys.exit(__doc__)
    write()

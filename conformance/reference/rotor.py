# SPDX-License-Identifier: Apache-2.0
"""Rotors, section 14 of spec/l4d.md, and what section 16 makes of them."""

import math

from arithmetic import f32, f32_of_bits


def normalized_half(v):
    squares = [f32(x * x) for x in v]
    n2 = f32(f32(squares[0] + squares[1]) + f32(squares[2] + squares[3]))
    if n2 < f32_of_bits(0x2B8CBCCC):
        return [1.0, 0.0, 0.0, 0.0]
    q = f32(math.sqrt(n2))
    return [f32(x / q) for x in v]


def normalized_rotor(r):
    s, b01, b02, b12, b03, b13, b23, p = r
    return rotor_of(
        normalized_half([f32(s + p), f32(b01 - b23), f32(b02 + b13), f32(b12 - b03)]),
        normalized_half([f32(s - p), f32(b01 + b23), f32(b02 - b13), f32(b12 + b03)]))


def stereographic_half(w):
    w = [f32(f32(x + 1.5) - 1.5) for x in w]
    squares = [f32(x * x) for x in w]
    n2 = f32(f32(squares[0] + squares[1]) + squares[2])
    r = f32(2.0 / f32(1.0 + n2))
    return [f32(r - 1.0)] + [f32(x * r) for x in w]


def stereographic_rotor(u, v):
    return rotor_of(stereographic_half([f32(x + y) for x, y in zip(u, v)]),
                    stereographic_half([f32(x - y) for x, y in zip(u, v)]))


def rotor_of(a, b):
    return [f32(x * 0.5) for x in
            (f32(a[0] + b[0]), f32(a[1] + b[1]), f32(a[2] + b[2]), f32(a[3] + b[3]),
             f32(b[3] - a[3]), f32(a[2] - b[2]), f32(b[1] - a[1]), f32(a[0] - b[0]))]


# ---- section 16, in binary64 ---------------------------------------------------------------------

def unit_half(v):
    n2 = sum(x * x for x in v)
    return [1.0, 0.0, 0.0, 0.0] if n2 < 1e-12 else [x / math.sqrt(n2) for x in v]


def slice_of(rotor, log_scale):
    """(lambda, velocity x y z) of a Gaussian."""
    s, b01, b02, b12, b03, b13, b23, p = rotor
    a = [s + p, b01 - b23, b02 + b13, b12 - b03]
    b = [s - p, b01 + b23, b02 - b13, b12 + b03]
    a, b = map(unit_half, (a, b))
    q = [[x * y for y in b] for x in a]
    rows = [[q[0][0] - q[1][1] - q[2][2] + q[3][3], q[0][1] + q[1][0] - q[2][3] - q[3][2],
             q[0][2] + q[2][0] + q[1][3] + q[3][1], q[0][3] - q[3][0] - q[1][2] + q[2][1]],
            [-q[0][1] - q[1][0] - q[2][3] - q[3][2], q[0][0] - q[1][1] + q[2][2] - q[3][3],
             q[0][3] + q[3][0] - q[1][2] - q[2][1], -q[0][2] + q[2][0] - q[1][3] + q[3][1]],
            [q[1][3] + q[3][1] - q[0][2] - q[2][0], -q[0][3] - q[3][0] - q[1][2] - q[2][1],
             q[0][0] + q[1][1] - q[2][2] - q[3][3], q[0][1] - q[1][0] - q[2][3] + q[3][2]],
            [-q[0][3] + q[3][0] - q[1][2] + q[2][1], q[0][2] - q[2][0] - q[1][3] + q[3][1],
             -q[0][1] + q[1][0] - q[2][3] + q[3][2], q[0][0] + q[1][1] + q[2][2] + q[3][3]]]
    scale = [math.exp(v) for v in log_scale]
    m = [[x * y for x, y in zip(row, scale)] for row in rows]
    dot = lambda u, v: sum(x * y for x, y in zip(u, v))
    rate = 1 / max(dot(m[3], m[3]), 1e-12)
    return rate, [dot(m[i], m[3]) * rate for i in range(3)]

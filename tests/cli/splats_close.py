#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Whether two 3DGS PLY hold the same Gaussians, in any order, within tolerances.

    splats_close.py A.ply B.ply NAME=MOST...

Names: position (distance), covariance (relative), color (of 0 to 1), opacity, sh (coefficients). Prints the largest
error of each, and ends with 1 where one is larger than its tolerance."""

import math
import struct
import sys

TYPES = {"float": "f", "double": "d", "uchar": "B", "int": "i", "uint": "I"}


def read(name):
    data = open(name, "rb").read()
    end = data.index(b"end_header\n") + 11
    lines = data[:end].decode().splitlines()
    assert "format binary_little_endian 1.0" in lines, name
    columns = [line.split()[1:] for line in lines if line.startswith("property")]
    row = struct.Struct("<" + "".join(TYPES[kind] for kind, _ in columns))
    names = [column for _, column in columns]
    return [dict(zip(names, row.unpack_from(data, at))) for at in range(end, len(data), row.size)]


def covariance(row):
    q = [row[f"rot_{k}"] for k in range(4)]
    length = math.sqrt(sum(x * x for x in q))
    w, x, y, z = (value / length for value in q)
    matrix = [[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
              [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
              [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]]
    variance = [math.exp(2 * row[f"scale_{k}"]) for k in range(3)]
    return [sum(matrix[i][k] * variance[k] * matrix[j][k] for k in range(3)) for i in range(3) for j in range(3)]


def distance(a, b):
    return math.sqrt(sum((x - y) ** 2 for x, y in zip(a, b)))


def place(row):
    return (row["x"], row["y"], row["z"])


def errors(a, b):
    c, d = covariance(a), covariance(b)
    rest = [name for name in a if name.startswith("f_rest_")]
    assert rest == [name for name in b if name.startswith("f_rest_")], "degrees differ"
    opacity = [1 / (1 + math.exp(-max(min(row["opacity"], 500), -500))) for row in (a, b)]
    return {"position": distance(place(a), place(b)),
            "covariance": distance(c, d) / distance(c, [0] * 9),
            "color": 0.28209479177387814 * max(abs(a[f"f_dc_{k}"] - b[f"f_dc_{k}"]) for k in range(3)),
            "opacity": abs(opacity[0] - opacity[1]),
            "sh": max((abs(a[name] - b[name]) for name in rest), default=0)}


def main(a, b, *tolerances):
    rows, others = read(a), read(b)
    assert len(rows) == len(others) > 0, (len(rows), len(others))
    most = {name: float(value) for name, value in (text.split("=") for text in tolerances)}
    worst = dict.fromkeys(("position", "covariance", "color", "opacity", "sh"), 0.0)
    left = list(others)
    for row in rows:
        # Of those that are as near as the nearest may be off, the one that is most alike.
        near = min(distance(place(row), place(other)) for other in left)
        found = min((other for other in left if distance(place(row), place(other)) <= near + most["position"]),
                    key=lambda other: sum(errors(row, other).values()))
        left.remove(found)
        for name, value in errors(row, found).items():
            worst[name] = max(worst[name], value)
    print(" ".join(f"{name}={value:.3g}" for name, value in worst.items()))
    return any(value > most[name] for name, value in worst.items())


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))

#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""How much several devices would share if each trained a range of time of a scene.

usage: shared_rows.py SCENE.ply [SCENE.ply ...]

SCENE is a PLY of this project (comment l4d_ply). For 2, 4 and 8 ranges of equal length, prints the
share of Gaussians that are visible in more than one range, and that of the range that holds most: a
Gaussian is visible within 4 temporal standard deviations of its mean time.
"""

import math
import struct
import sys

ROTOR = [f"rotor_{k}" for k in range(8)]  # s b01 b02 b12 b03 b13 b23 p


def read_rows(path):
    """Yields (columns of a row by name); returns the time range first."""
    with open(path, "rb") as file:
        header, names = {}, []
        for line in iter(lambda: file.readline().decode().split(), ["end_header"]):
            if line[:1] == ["comment"] and len(line) == 3:
                header[line[1]] = line[2]
            elif line[:2] == ["element", "vertex"]:
                count = int(line[2])
            elif line[:1] == ["property"]:
                assert line[1] == "float", f"{path}: {line}"
                names.append(line[2])
        assert header.get("l4d_ply") == "1", f"{path}: not a PLY of this project"
        row = struct.Struct(f"<{len(names)}f")
        wanted = [names.index(n) for n in ["t", *(f"scale_{k}" for k in range(4)), *ROTOR]]
        body = file.read(row.size * count)
    rows = [[values[k] for k in wanted] for values in row.iter_unpack(body)]
    return float(header["time_begin"]), float(header["time_end"]), rows


def unit(half):
    length = math.sqrt(sum(v * v for v in half))
    return [v / length for v in half] if length > 1e-6 else [1, 0, 0, 0]


def temporal_deviation(log_scale, rotor):
    """The row of time of the rotation, times the scales (libl4dcodec/math/rotor.h)."""
    s, b01, b02, b12, b03, b13, b23, p = rotor
    a = unit([s + p, b01 - b23, b02 + b13, b12 - b03])
    b = unit([s - p, b01 + b23, b02 - b13, b12 + b03])
    row = [-((a[0] * b[3] - a[3] * b[0]) + (a[1] * b[2] - a[2] * b[1])),
           (a[0] * b[2] - a[2] * b[0]) - (a[1] * b[3] - a[3] * b[1]),
           -((a[0] * b[1] - a[1] * b[0]) + (a[2] * b[3] - a[3] * b[2])),
           (a[0] * b[0] + a[1] * b[1]) + (a[2] * b[2] + a[3] * b[3])]
    return math.sqrt(sum((r * math.exp(l)) ** 2 for r, l in zip(row, log_scale)))


def main():
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    print("| scene | s | Gaussians | ranges | in more than one | in the fullest |")
    print("|---|---:|---:|---:|---:|---:|")
    for path in sys.argv[1:]:
        begin, end, rows = read_rows(path)
        spans = []
        for row in rows:
            reach = 4 * temporal_deviation(row[1:5], row[5:13])
            spans.append((row[0] - begin - reach, row[0] - begin + reach))
        for ranges in (2, 4, 8):
            length = (end - begin) / ranges
            shared, held = 0, [0] * ranges
            for first, last in spans:
                low = max(0, min(ranges - 1, math.floor(first / length)))
                high = max(0, min(ranges - 1, math.floor(last / length)))
                shared += high > low
                for k in range(low, high + 1):
                    held[k] += 1
            print(f"| {path.rsplit('/', 1)[-1]} | {end - begin:g} | {len(spans)} | {ranges} "
                  f"| {100 * shared / len(spans):.1f} % | {100 * max(held) / len(spans):.1f} % |")


if __name__ == "__main__":
    main()

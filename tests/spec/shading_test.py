#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The numbers of section 16, against closed forms and the independent reader.

    shading_test.py           spec/examples/shading.json holds what the closed forms give; splats.py agrees with it
    shading_test.py --write   writes the file

C++ (tests/math/shading_test.cc) and the text of all shaders (web/view/test/rules.test.js) read the same file.
"""
import decimal
import json
import math
import pathlib
import sys

import splats

TABLE = pathlib.Path(__file__).resolve().parents[2] / "spec" / "examples" / "shading.json"
D = decimal.Decimal
PI = D("3.14159265358979323846264338327950288419716939937510582097494")
# Directions of whole numbers, whose length is a whole number, too.
DIRECTIONS = ((1, 0, 0), (0, 1, 0), (0, 0, 1), (2, 3, 6), (-1, 4, 8), (4, -4, -7), (-6, -10, 15), (12, 20, -9))
LAMBDAS = ("0.25", "1", "64", "1048576")  # 1/s^2, powers of 4
SIGMAS = ("0", "-0.5", "1", "-2", "3.75", "-4", "4.25")  # from the mean time


def basis(x, y, z):
    """Real spherical harmonics with the signs of 3D Gaussian splatting: [16]"""
    def over_pi(number, divisor):
        return (D(number) / PI).sqrt() / divisor
    k1, k2 = over_pi(3, 2), over_pi(15, 2)
    k3 = [over_pi(D(35) / 2, 4), over_pi(105, 2), over_pi(D(21) / 2, 4), over_pi(7, 4)]
    xx, yy, zz = x * x, y * y, z * z
    return [over_pi(1, 2), -k1 * y, k1 * z, -k1 * x,
            k2 * x * y, -k2 * y * z, over_pi(5, 4) * (2 * zz - xx - yy), -k2 * x * z, k2 / 2 * (xx - yy),
            -k3[0] * y * (3 * xx - yy), k3[1] * x * y * z, -k3[2] * y * (4 * zz - xx - yy),
            k3[3] * z * (2 * zz - 3 * xx - 3 * yy), -k3[2] * x * (4 * zz - xx - yy), k3[1] / 2 * z * (xx - yy),
            -k3[0] * x * (xx - 3 * yy)]


def table():
    decimal.getcontext().prec = 50
    sh = []
    for direction in DIRECTIONS:
        length = D(math.isqrt(sum(v * v for v in direction)))
        unit = [D(v) / length for v in direction]
        sh.append({"direction": [float(v) for v in unit], "basis": [float(v) + 0.0 for v in basis(*unit)]})
    falloff = []
    for lam in LAMBDAS:
        for sigmas in SIGMAS:
            # Roots of powers of 4 are exact, and so is lambda dt^2 in any precision.
            dt = D(sigmas) / D(lam).sqrt()
            falloff.append({"lambda": float(lam), "dt": float(dt), "visible": abs(D(sigmas)) <= 4,
                            "falloff": float((-D(sigmas) ** 2 / 2).exp())})
    return {"about": "Section 16 of the specification: Y_k(d), and the falloff exp(-lambda dt^2 / 2) of a Gaussian, which "
                     "is visible while lambda dt^2 <= 16", "sh": sh, "falloff": falloff}


def text_of(document):
    def rows(key):
        return f' "{key}": [\n' + ",\n".join("  " + json.dumps(row) for row in document[key]) + "\n ]"
    return f'{{\n "about": {json.dumps(document["about"])},\n{rows("sh")},\n{rows("falloff")}\n}}\n'


def main():
    text = text_of(table())
    if sys.argv[1:] == ["--write"]:
        TABLE.write_text(text, encoding="utf-8")
        return 0
    assert TABLE.read_text(encoding="utf-8") == text, f"{TABLE} is not what the closed forms give: shading_test.py --write"
    document = json.loads(text)
    for row in document["sh"]:
        for degree in range(4):
            found = splats.basis(row["direction"], degree)
            assert len(found) == (degree + 1) ** 2
            assert all(abs(a - b) < 2e-15 for a, b in zip(found, row["basis"])), row
    for row in document["falloff"]:
        # A temporal axis alone: m_t = (0, 0, 0, sigma).
        g = {"rotor": [1, 0, 0, 0, 0, 0, 0, 0], "log_scale": [0, 0, 0, -math.log(row["lambda"]) / 2], "mean_t": [10],
             "position": [0, 0, 0], "opacity": [1]}
        found = splats.sliced(g, 10 + row["dt"], 10)["opacity"]
        assert abs(found - row["falloff"]) < 1e-9, (row, found)
    print(f"{len(document['sh'])} directions, {len(document['falloff'])} falloffs")
    return 0


if __name__ == "__main__":
    sys.exit(main())

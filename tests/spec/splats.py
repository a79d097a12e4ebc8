# SPDX-License-Identifier: Apache-2.0
"""Slicing and compositing in double precision, as section 16 and appendix H of spec/l4d.md have them,
for scenes of a few Gaussians."""

import math
from dataclasses import dataclass

MIN_TRANSMITTANCE = 1e-4
MARGIN = 0.15                             # of the width and height, on each side


@dataclass
class Rendering:
    """Section 8.6, with its defaults."""

    dilation: float = 0.3
    cutoff: float = 0.0
    min_alpha: float = 1 / 255
    max_alpha: float = 0.999
    compensation: bool = False


DEFAULT = Rendering()


@dataclass
class Camera:
    width: int
    height: int
    f: tuple                              # fx fy
    c: tuple                              # cx cy
    rotation: list                        # world to camera, rows
    translation: list
    near: float = 0.02

    def text(self):
        rows = [n for row, t in zip(self.rotation, self.translation) for n in (*row, t)]
        return " ".join(map(repr, [self.width, self.height, *self.f, *self.c, self.near, *rows]))

    def centre(self):
        return [-v for v in apply(transposed(self.rotation), self.translation)]


def dot(a, b):
    return sum(x * y for x, y in zip(a, b))


def apply(matrix, v):
    return [dot(row, v) for row in matrix]


def transposed(matrix):
    return [list(column) for column in zip(*matrix)]


def product(a, b):
    return [[dot(row, column) for column in zip(*b)] for row in a]


# ---- section 16 ----------------------------------------------------------------------------------

def normalised_halves(rotor):
    s, b01, b02, b12, b03, b13, b23, p = rotor
    for v in ([s + p, b01 - b23, b02 + b13, b12 - b03], [s - p, b01 + b23, b02 - b13, b12 + b03]):
        norm = math.sqrt(dot(v, v))
        yield [x / norm for x in v]


def rotation_of(rotor):
    """M: rows are world axes x y z t, columns local ones."""
    a, b = normalised_halves(rotor)
    p = [[x * y for y in b] for x in a]
    return [
        [p[0][0] - p[1][1] - p[2][2] + p[3][3], p[0][1] + p[1][0] - p[2][3] - p[3][2],
         p[0][2] + p[2][0] + p[1][3] + p[3][1], p[0][3] - p[3][0] - p[1][2] + p[2][1]],
        [-p[0][1] - p[1][0] - p[2][3] - p[3][2], p[0][0] - p[1][1] + p[2][2] - p[3][3],
         p[0][3] + p[3][0] - p[1][2] - p[2][1], -p[0][2] + p[2][0] - p[1][3] + p[3][1]],
        [p[1][3] + p[3][1] - p[0][2] - p[2][0], -p[0][3] - p[3][0] - p[1][2] - p[2][1],
         p[0][0] + p[1][1] - p[2][2] - p[3][3], p[0][1] - p[1][0] - p[2][3] + p[3][2]],
        [-p[0][3] + p[3][0] - p[1][2] + p[2][1], p[0][2] - p[2][0] - p[1][3] + p[3][1],
         -p[0][1] + p[1][0] - p[2][3] + p[3][2], p[0][0] + p[1][1] + p[2][2] + p[3][3]]]


def velocity_of(g):
    rows = scaled_rows(g)
    return [dot(row, rows[3]) / dot(rows[3], rows[3]) for row in rows[:3]]


def scaled_rows(g):
    return [[m * math.exp(s) for m, s in zip(row, g["log_scale"])] for row in rotation_of(g["rotor"])]


def sliced(g, t, t_ref, permanent=False):
    """What section 16 calls lambda, v, covariance, centre and opacity of a Gaussian at t."""
    m = scaled_rows(g)
    lam = 1 / max(dot(m[3], m[3]), 1e-12)
    v = [dot(row, m[3]) * lam for row in m[:3]]
    p = [[x - vi * y for x, y in zip(row, m[3])] for row, vi in zip(m, v)]
    fade = 1 if permanent else math.exp(-lam * (t - g["mean_t"][0]) ** 2 / 2)
    return {"lambda": lam, "v": v, "covariance": [[dot(a, b) for b in p] for a in p],
            "centre": [x + vi * (t - t_ref) for x, vi in zip(g["position"], v)],
            "opacity": g["opacity"][0] * fade}


def basis(d, degree):
    """Y_k(d)"""
    x, y, z = d
    c = -0.4886025119029199
    out = [0.28209479177387814, c * y, -c * z, c * x]
    c, e = 1.0925484305920792, 0.31539156525252005
    out += [c * x * y, -c * y * z, e * (2 * z * z - x * x - y * y), -c * x * z, c / 2 * (x * x - y * y)]
    a, b, c, e = -0.5900435899266435, 2.890611442640554, -0.4570457994644658, 0.3731763325901154
    out += [a * y * (3 * x * x - y * y), b * x * y * z, c * y * (4 * z * z - x * x - y * y),
            e * z * (2 * z * z - 3 * x * x - 3 * y * y), c * x * (4 * z * z - x * x - y * y),
            b / 2 * z * (x * x - y * y), a * x * (x * x - 3 * y * y)]
    return out[:(degree + 1) ** 2]


def colour(sh, d):
    degree = math.isqrt(len(sh) // 3) - 1
    y = basis(d, degree)
    return [max(0.0, 0.5 + dot(y, sh[channel::3])) for channel in range(3)]


# ---- appendix H ----------------------------------------------------------------------------------

def splat(slice_, sh, camera, how=DEFAULT):
    """The splat of a Gaussian in the image, or None where it is left out."""
    z_axis = camera.rotation[2]
    x, y, z = (v + t for v, t in zip(apply(camera.rotation, slice_["centre"]), camera.translation))
    if not z > camera.near or slice_["opacity"] < how.min_alpha:
        return None
    rows, slopes = [], []
    for k, (at, size) in enumerate(((x, camera.width), (y, camera.height))):
        low = (-camera.c[k] - MARGIN * size) / camera.f[k]
        high = (size - camera.c[k] + MARGIN * size) / camera.f[k]
        slope = min(max(at / z, low), high)
        slopes.append(slope)
        rows.append([camera.f[k] / z * (r - slope * rz) for r, rz in zip(camera.rotation[k], z_axis)])
    undilated = product(product(rows, slice_["covariance"]), transposed(rows))
    cov = [[v + how.dilation * (i == j) for j, v in enumerate(row)] for i, row in enumerate(undilated)]
    det, opacity = determinant(cov), slice_["opacity"]
    if how.compensation:
        opacity *= math.sqrt(max(determinant(undilated), 0.0) / det)
    if not det > 0 or opacity < how.min_alpha:
        return None
    d = [a - b for a, b in zip(slice_["centre"], camera.centre())]
    norm = math.sqrt(dot(d, d))
    return {"camera": [x, y, z], "slope": slopes, "J": rows, "undilated": undilated,
            "covariance": cov, "direction": [v / norm for v in d],
            "mean": [camera.f[0] * x / z + camera.c[0], camera.f[1] * y / z + camera.c[1]],
            "conic": [cov[1][1] / det, -cov[0][1] / det, cov[0][0] / det], "depth": z,
            "opacity": opacity, "colour": colour(sh, [v / norm for v in d])}


def determinant(m):
    return m[0][0] * m[1][1] - m[0][1] * m[1][0]


def alpha_at(s, px, py, how=DEFAULT):
    """(dx, dy, q, alpha) of a splat at the centre of pixel px, py; alpha before the cut-off."""
    dx, dy = px + 0.5 - s["mean"][0], py + 0.5 - s["mean"][1]
    q = s["conic"][0] * dx * dx + 2 * s["conic"][1] * dx * dy + s["conic"][2] * dy * dy
    return dx, dy, q, min(how.max_alpha, s["opacity"] * math.exp(-q / 2))


def pixel(splats, px, py, background, how=DEFAULT):
    """[r, g, b, alpha] of a pixel; splats: nearest first."""
    left, out = 1.0, [0.0, 0.0, 0.0]
    for s in splats:
        _, _, q, alpha = alpha_at(s, px, py, how)
        if alpha < how.min_alpha or how.cutoff > 0 and q > how.cutoff ** 2:
            continue
        if left * (1 - alpha) < MIN_TRANSMITTANCE:
            break
        out = [o + left * alpha * c for o, c in zip(out, s["colour"])]
        left *= 1 - alpha
    return [o + left * b for o, b in zip(out, background)] + [1 - left]


def image(slices, shs, camera, background, how=DEFAULT):
    splats = [splat(s, sh, camera, how) for s, sh in zip(slices, shs)]
    splats = sorted((s for s in splats if s is not None), key=lambda s: s["depth"])
    return [pixel(splats, px, py, background, how)
            for py in range(camera.height) for px in range(camera.width)]

# SPDX-License-Identifier: Apache-2.0
"""The decoding process, section 14 of spec/l4d.md: from the columns of a page to attributes."""

import math
import struct

from arithmetic import f32, f32_of_bits, half, limit, require, unorder
from codebooks import BASIS
from header import (CONSTANT, F16, FIXED, RAW32, RAW64, ROTOR_SPATIAL, ROTOR_TEMPORAL, SCALE,
                    SH, TRANSFORM, VQ, WINDOW, ZERO, component, position_coding, vector_length)
from page import ESCAPE, ordered_mean_time
from rotor import normalized_rotor, stereographic_rotor
from times import center_of_bucket, width_of_bucket, window_middle


def ordered_half(v):
    return half(unorder(v, 16))


def attributes(page, codebooks, block_codebooks):
    """Name -> a row for each Gaussian, in the order of the page."""
    local, mean, exact = mean_times(page)
    rows = {c: vectors(page, c, codebooks, block_codebooks.get(c)) for c in (SCALE, ROTOR_SPATIAL,
                                                                         ROTOR_TEMPORAL, SH)}
    windows = {} if page.window is None else {"window": [list(w) for w in page.window]}
    return {"position": positions(page), "mean_t_local": [[v] for v in local],
            "mean_t": [[v] for v in mean], "mean_t_double": [[v] for v in exact],
            "log_scale": log_scales(page, rows[SCALE]),
            "rotor": rotors(page, rows[ROTOR_SPATIAL], rows[ROTOR_TEMPORAL]),
            "opacity": [[v] for v in opacities(page)], "sh": [list(row) for row in rows[SH]],
            **windows}


def positions(page):
    h, coding, columns = page.header, position_coding(page.header, page.index), []
    for axis, column in zip("xyz", page.position):
        if coding == RAW32:
            columns.append([f32_of_bits(v) for v in column])
            continue
        center, scale = h["position_center"][axis], h["position_scale"]
        coded = column if coding == FIXED else map(ordered_half, column)
        columns.append([f32(center + f32(scale * v)) for v in coded])
    return [list(row) for row in zip(*columns)]


def mean_times(page):
    """local, mean_t and the exact mean time of each Gaussian"""
    h, layer = page.header, page.layer
    width = width_of_bucket(h, layer["level"])
    center = center_of_bucket(h, layer["level"], page.record["bucket"])
    if layer["mean_t"] == RAW32:
        mean = [f32_of_bits(v) for v in page.mean_t]
        return [f32(v - center) for v in mean], mean, mean
    if layer["mean_t"] == RAW64:
        exact = [struct.unpack("<d", struct.pack("<Q", v))[0] for v in page.mean_t]
        require(all(abs(v) <= 2.0 ** 60 for v in exact), "VAL-3", "mean_t is out of range")
        return [f32(v - center) for v in exact], [f32(v) for v in exact], exact
    if layer["mean_t"] == WINDOW:
        exact = [window_middle(h, w) for w in page.window]
        return [f32(v - center) for v in exact], [f32(v) for v in exact], exact
    local = [0.0] * page.n
    if layer["mean_t"] == F16:
        shift = int(layer["mean_t_shift"])
        local = [f32(f32(width) * ordered_half(ordered_mean_time(m, shift))) for m in page.mean_t]
    elif layer["mean_t"] == FIXED:
        parts = map(part_of_step, page.mean_t_fine or [0] * page.n)
        local = [f32(layer["mean_t_step"] * f32(f32(m - layer["mean_t_zero"]) + part))
                 for m, part in zip(page.mean_t, parts)]
    exact = [center + v for v in local]
    return local, [f32(v) for v in exact], exact


def part_of_step(fine):
    """Where in the step of a fixed mean time the middle of the cell lies that `fine` names."""
    r = fine + 1
    k = r.bit_length() - 1
    return (2 * (r - 2 ** k) + 1 - 2 ** k) / 2 ** (k + 1)


def scalars(coding, column, n):
    if coding["coding"] == CONSTANT:
        return [coding["offset"]] * n
    if coding["coding"] == RAW32:
        return [f32_of_bits(v) for v in column]
    return [f32(coding["offset"] + f32(coding["step"] * code)) for code in column]


def opacities(page):
    h = page.header
    values = scalars(h["opacity"], page.opacity, page.n)
    if h["opacity_logit"]:
        return values
    if h["opacity"]["coding"] == RAW32:
        require(all(0 <= v <= 1 for v in values), "VAL-4", "opacity")
        return values
    return [limit(v, 0.0, 1.0) for v in values]


def vectors(page, c, codebooks, block_codebook):
    """The rows of a component."""
    coding, dim = component(page.header, page.index, c), vector_length(page.header, page.index, c)
    columns, n = page.component.get(c), page.n
    if columns is None:                   # DEC-7: of SH without a base, no part is there
        has_origin = coding["coding"] == TRANSFORM
        return [codebooks.codebook(page.index, c, BASIS)[0] if has_origin else [0.0] * dim] * n
    if coding["coding"] == ZERO:
        return [[0.0] * dim] * n
    if coding["coding"] == RAW32:
        return list(zip(*[[f32_of_bits(v) for v in column] for column in columns["raw"]]))
    if coding["coding"] == VQ:
        codebooks = [codebooks.codebook(page.index, c, s) for s in range(len(coding["stages"]))]
        return sums_of_codewords(columns, [block_codebook or codebooks[0], *codebooks[1:]], dim)
    rows_of = transformed_by_integers if c == SH else transformed
    return rows_of(columns, coding["steps"], codebooks.codebook(page.index, c, BASIS))


def sums_of_codewords(columns, codebooks, dim):
    index, escape = [iter(column) for column in columns["index"]], zip(*columns["escape"])
    rows = []
    for depth in columns["depth"]:
        if depth == ESCAPE:
            rows.append([ordered_half(v) for v in next(escape)])
            continue
        row = [0.0] * dim
        for s in range(depth):
            codeword = codebooks[s][next(index[s])]
            row = list(codeword) if s == 0 else [f32(a + b) for a, b in zip(row, codeword)]
        rows.append(row)
    return rows


def transformed(columns, steps, basis):
    rows = []
    for step_exponent, coefficients in zip(columns["step_exponent"], columns["coefficient"]):
        row = list(basis[0])
        for k, q in enumerate(coefficients):
            amount = f32(f32(q * 2.0 ** -step_exponent) * steps[k])
            row = [f32(v + f32(amount * b)) for v, b in zip(row, basis[k + 1])]
        rows.append(row)
    return rows


def integers_of(steps, vectors):
    """The vectors m of SH and the power of two, e, that they are multiplied by."""
    w = [[f32(step * b) for b in vector] for step, vector in zip(steps, vectors)]
    e = math.frexp(max(abs(x) for vector in w for x in vector))[1] - 15
    # round() takes ties to the even integer.
    return [[limit(round(x * 2.0 ** -e), -32767, 32767) for x in vector] for vector in w], e


def transformed_by_integers(columns, steps, basis):
    m, e = integers_of(steps, basis[1:])
    rows = []
    for step_exponent, coefficients in zip(columns["step_exponent"], columns["coefficient"]):
        scale = 2.0 ** (e - step_exponent)
        row = []
        for d, origin in enumerate(basis[0]):
            total = sum(q * m[k][d] for k, q in enumerate(coefficients)) & 0xFFFFFFFF
            total -= (total >> 31) << 32
            row.append(f32(origin + f32(f32(total) * scale)))
        rows.append(row)
    return rows


def log_scales(page, rows):
    layer = page.layer
    if layer["scale"]["coding"] == RAW32:
        require(all(abs(v) <= 17 for row in rows for v in row), "VAL-4", "log scale")
        out = [list(row) for row in rows]
    else:
        factor = scalars(layer["scale_factor"], page.scale_factor, page.n)
        out = [[limit(f32(f + v), -17.0, 17.0) for v in row] for f, row in zip(factor, rows)]
    last = [limit(layer["log_scale_t"], -17.0, 17.0)] * layer["permanent"]
    return [row + last for row in out]


def rotors(page, spatial, temporal):
    coding = page.layer["rotor_spatial"]["coding"]
    if coding == TRANSFORM:               # of a temporal part that is zero, three of its numbers
        return [stereographic_rotor(u, v[:3]) for u, v in zip(spatial, temporal)]
    pairs = [list(u) + list(v) for u, v in zip(spatial, temporal)]
    return pairs if coding == RAW32 else [normalized_rotor(r) for r in pairs]

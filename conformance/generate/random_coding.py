# SPDX-License-Identifier: Apache-2.0
"""Random codings of scalars and components, for random_stream."""

import struct

import stream_builder as sb
from random_page import RAW32, TRANSFORM, VQ, ZERO, f32, half_value


def rows(rng, n, dim, tame=False, sq=True):
    """Of a codebook. tame: of small numbers. sq: of either element type, else of binary16."""
    if rng.random() < 0.3 and sq:
        most = rng.choice([1, 40] if tame else [1, 40, 300, 32767])
        step = f32(rng.uniform(2.0 ** -20, 2.0 ** -6) if tame else
                   rng.choice([2.0 ** -20, 2.0 ** 10, rng.uniform(2.0 ** -20, 1)]))
        return sb.Multiples([[rng.randint(-most - 1, most) for _ in range(dim)] for _ in range(n)], step)
    round16 = lambda v: struct.unpack("<e", struct.pack("<e", v))[0]
    number = (lambda: rng.uniform(-2, 2)) if tame else lambda: half_value(rng)
    return [[round16(number()) for _ in range(dim)] for _ in range(n)]


def entries(rng):
    return rng.choice([1, 2, 3, 4, 5, 16, 17, 33])


def component(rng, dim, may_be_raw=True, may_have_rcq=False, tame=False):
    """Of any coding but a rotor transform."""
    coding = rng.choice([ZERO, VQ, VQ, VQ, TRANSFORM, TRANSFORM] + [RAW32] * may_be_raw)
    if coding == TRANSFORM:
        return transform(rng, dim)
    if coding == VQ:
        return vq(rng, dim, may_have_rcq, tame=tame)
    return {"coding": coding, **ignored(rng, True)}


def ignored(rng, stages=False):
    """Fields that mean nothing unless the coding is transform; with stages, unless it is vq."""
    if rng.random() < 0.8:
        return {}
    also = {"steps": [float("nan"), 0.0], "eob_table": [7, 0]}
    return {"also": {**also, "stages": [], "escapes": True} if stages else also}


def rotors(rng, may_be_raw, may_have_rcq):
    """rotor_spatial and rotor_temporal"""
    if rng.random() < 0.4:
        return transform(rng, 3, 1.0), rng.choice([{"coding": ZERO}, transform(rng, 3, 1.0)])
    choose = lambda raw: rng.choice([ZERO, VQ, VQ, VQ] + [RAW32] * raw)
    spatial = choose(may_be_raw)
    return [vq(rng, 4, may_have_rcq) if coding == VQ else {"coding": coding}
            for coding in (spatial, choose(spatial == RAW32))]


def vq(rng, dim, may_have_rcq=False, tame=False, stages=None, escapes=None, sizes=None):
    number = stages or rng.choice([1, 1, 2, 3, 8])
    size = lambda: rng.choice(sizes) if sizes else entries(rng)
    out = {"coding": VQ, "escapes": rng.random() < 0.4 and not tame if escapes is None else escapes,
           **ignored(rng), "stages": [rows(rng, size(), dim, tame) for _ in range(number)]}
    if may_have_rcq and rng.random() < 0.6:
        out["rcq"] = rows(rng, entries(rng), dim, tame)
    return out


def transform(rng, dim, most_step=2.0 ** 10, number=None):
    number = number or rng.randint(1, dim)
    step = lambda: f32(rng.choice([2.0 ** -20, most_step, rng.uniform(2.0 ** -20, most_step),
                                   rng.power_of_two(-20, 0)]))
    below = rng.sample(range(1, number), min(number - 1, rng.choice([0, 0, 1, 2, 6, number])))
    return {"coding": TRANSFORM, "steps": [step() for _ in range(number)],
            "eob_table": [*sorted(below), number], "basis": rows(rng, number + 1, dim, sq=False),
            "also": {"escapes": rng.random() < 0.2}}


def scalar(rng, may_be_raw=True):
    coding = rng.choice([0, 1, 2, 2, 2] if may_be_raw else [0, 2, 2])
    number = lambda: f32(rng.choice([0.0, rng.uniform(-2, 2), 2.0 ** -60, 2.0 ** 40]))
    return {"coding": coding, "bits": rng.randint(1, 16), "offset": number(), "step": number()}


# ---- LAYR-1 --------------------------------------------------------------------------------------

def greatest(rows_of_codebook):
    step = getattr(rows_of_codebook, "step", 1.0)
    return max(abs(v) for row in rows_of_codebook for v in row) * step


def most_of(coding):
    """No number of a vector of this coding is greater."""
    if coding["coding"] == TRANSFORM:
        basis = coding["basis"]
        return (max(map(abs, basis[0])) +
                sum(32768 * step * max(map(abs, row)) for step, row in zip(coding["steps"], basis[1:])))
    if coding["coding"] != VQ:
        return 0.0
    codebooks = coding["stages"] + ([coding["rcq"]] if coding.get("rcq") else [])
    return max(sum(map(greatest, codebooks)), 65504.0 * coding["escapes"])


def bound_log_scales(layer, window):
    """Sets the offset of the scale factor so that all log scales fit the layer."""
    factor = layer["scale_factor"]
    if layer["level"] == 0 or layer["scale"]["coding"] == RAW32:
        return
    most = most_of(layer["scale"])
    codes = max(factor["step"] * ((1 << factor["bits"]) - 1), 0.0) if factor["coding"] == 2 else 0.0
    slack = 1e-5 * (most + codes)               # for the rounding of sums in binary32
    factor["offset"] = f32(window.most_log_scale() - most - codes - slack - 1e-4)

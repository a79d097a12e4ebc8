# SPDX-License-Identifier: Apache-2.0
"""Random valid scenes for stream_builder: codings, layers, blocks and stream forms in combinations
that the encoder does not choose. Only LAYR-1, DIR-9 and DIR-10, which decoders do not check, are
left to chance."""

import random
import struct

import random_page
import stream_builder as sb
from random_page import FIXED, RAW32, RAW64, TRANSFORM, VQ, ZERO, f32, half_value


def rows(rng, n, dim):
    if rng.random() < 0.3:
        most = rng.choice([1, 40, 300, 32767])
        step = f32(rng.choice([2.0 ** -20, 2.0 ** 10, rng.uniform(2.0 ** -20, 1)]))
        return sb.Multiples([[rng.randint(-most - 1, most) for _ in range(dim)] for _ in range(n)], step)
    round16 = lambda v: struct.unpack("<e", struct.pack("<e", v))[0]
    return [[round16(half_value(rng)) for _ in range(dim)] for _ in range(n)]


def entries(rng):
    return rng.choice([1, 2, 3, 4, 5, 16, 17, 33])


def component(rng, dim, may_be_raw=True, may_have_rcq=False):
    """Of any coding but a rotor transform."""
    coding = rng.choice([ZERO, VQ, VQ, VQ, TRANSFORM, TRANSFORM] + [RAW32] * may_be_raw)
    if coding == TRANSFORM:
        return transform(rng, dim)
    return vq(rng, dim, may_have_rcq) if coding == VQ else {"coding": coding, **ignored(rng, True)}


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


def vq(rng, dim, may_have_rcq):
    out = {"coding": VQ, "escapes": rng.random() < 0.4, **ignored(rng),
           "stages": [rows(rng, entries(rng), dim) for _ in range(rng.choice([1, 1, 2, 3, 8]))]}
    if may_have_rcq and rng.random() < 0.6:
        out["rcq"] = rows(rng, entries(rng), dim)
    return out


def transform(rng, dim, most_step=2.0 ** 10):
    number = rng.randint(1, dim)
    step = lambda: f32(rng.choice([2.0 ** -20, most_step, rng.uniform(2.0 ** -20, most_step),
                                   2.0 ** rng.uniform(-20, 0)]))
    below = rng.sample(range(1, number), min(number - 1, rng.choice([0, 0, 1, 2, 6, number])))
    return {"coding": TRANSFORM, "steps": [step() for _ in range(number)],
            "eob_table": [*sorted(below), number], "basis": rows(rng, number + 1, dim),
            "also": {"escapes": rng.random() < 0.2}}


def scalar(rng, may_be_raw=True):
    coding = rng.choice([0, 1, 2, 2, 2] if may_be_raw else [0, 2, 2])
    number = lambda: f32(rng.choice([0.0, rng.uniform(-2, 2), 2.0 ** -60, 2.0 ** 40]))
    return {"coding": coding, "bits": rng.randint(1, 16), "offset": number(), "step": number()}


class RandomScene:
    def __init__(self, seed):
        self.rng = rng = random.Random(seed)
        self.may_be_raw = rng.random() < 0.4     # else any layer may have rANS pages
        self.frames = rng.choice([1, 2, 3, 7, 30, 300])
        degree = rng.choice([0, 0, 1, 2, 3])
        self.sh_dim = 3 * (degree + 1) ** 2
        self.scene = {
            "time_begin": rng.choice([0.0, -2.5, 12.34, 1e5, -2.0 ** -60]),
            "num_frames": self.frames, "fps_num": rng.choice([30, 60, 24000, 1, 4294967295]),
            "fps_den": rng.choice([1, 1001, 7]),
            "gate": f32(rng.choice([16.0, 11.08, 0.5])),
            "origin": {k: rng.uniform(-1e7, 1e7) for k in "xyz"},
            "world_scale": rng.uniform(0.1, 10),
            "coordinate_system": rng.choice([0, 1, 2, 99]), "color_space": rng.choice([0, 1, 99]),
            "position_at_mean_time": rng.random() < 0.3, "opacity_logit": rng.random() < 0.3,
            "position": rng.choice([2, FIXED] + [RAW32] * self.may_be_raw),
            "position_center": {k: f32(rng.choice([0.0, rng.uniform(-9, 9), -2.0 ** 60]))
                                for k in "xyz"},
            "position_scale": f32(rng.choice([1.0, 0.37, 2.0 ** -60, 2.0 ** 60])),
            "opacity": scalar(rng, self.may_be_raw), "sh_degree": degree,
            "sh": component(rng, self.sh_dim, self.may_be_raw),
            "metadata": [{"key": "a", "value": "\u00e4"}] * rng.randint(0, 2),
            "errors": rng.choice([None, {}, {"position": 0.5, "covariance": 1.25, "mean_t": 3e38,
                                             "min_size": 1e-3, "own_min_sizes": True}]),
            "rendering": rng.choice([None, {}, {"dilation": 0.1, "compensation": True},
                                     {"cutoff": 3.0, "min_alpha": 0.25, "max_alpha": 0.5}]),
            "presentation": rng.choice([None, {}, {
                "playback": rng.choice([1, 2, 3, 200]), "metres_per_unit": 0.01,
                "bounds": {"min": [-1.0, 0.0, -1e9], "max": [1.0, 0.0, 1e9]},
                "camera": {"position": [0.0, 1.0, 5.0], "target": [0.0, 0.0, 0.0],
                           "up": [0.0, 1.0, 0.0], "fov": 0.9}}]),
            "extensions": [{"id": 70000, "critical": False}] * rng.randint(0, 1),
        }
        sh = self.scene["sh"]
        most = len(sh["steps"]) if sh["coding"] == TRANSFORM else 0
        self.scene["sh_base"] = rng.choice([0, 0, most, rng.randint(0, most), rng.randint(0, most)])
        bits = rng.choice([1, 8, 15, 16, 21, rng.randint(1, 21)])
        fixed = self.scene["position"] == FIXED
        self.scene["position_bits"] = bits if fixed else rng.randrange(256)
        levels = sb.bit_width(self.frames) + 1
        layers = rng.randint(1, min(4, 2 * levels))
        chosen = sorted(rng.randrange(levels) for _ in range(layers))
        self.scene["layers"] = [self.layer(level) for level in chosen]
        self.scene["num_gaussians"] = sum(la["num_gaussians"] for la in self.scene["layers"])

    def layer(self, level):
        rng = self.rng
        permanent = level == 0 and rng.random() < 0.5
        scale = component(rng, 3 if permanent else 4, self.may_be_raw, level > 0)
        spatial, temporal = rotors(rng, self.may_be_raw, level > 0)
        layer = {"level": level, "permanent": permanent,
                 "mean_t": 0 if permanent else rng.choice([2, 2, 3, 3] + [RAW32, RAW64] * self.may_be_raw),
                 "mean_t_shift": rng.choice([0, rng.randint(0, 10), 10]),
                 "mean_t_bits": rng.choice([1, 16, rng.randint(1, 16)]),
                 "mean_t_zero": rng.choice([0, 65535, rng.randrange(1 << 16)]),
                 "mean_t_step": f32(rng.choice([2.0 ** -60, 2.0 ** 60, rng.uniform(1e-4, 0.1)])),
                 "mean_t_fine": rng.random() < 0.5,
                 "log_scale_t": f32(rng.choice([rng.uniform(-3, 9), 2.0 ** 60, -18.0])),
                 "raw_position": self.may_be_raw and rng.random() < 0.3,
                 "scale_factor": scalar(rng, may_be_raw=scale["coding"] == RAW32),
                 "scale": scale, "rotor_spatial": spatial, "rotor_temporal": temporal}
        buckets = 1 if level == 0 else 2 << level
        bits = layer["directory_bits"] = rng.randint(0, 3)
        layer["table_size"] = -(-buckets // (1 << bits))
        layer["blocks"], layer["pages"] = {}, []
        used = sorted(rng.sample(range(buckets), min(buckets, rng.randint(0, 5))))
        for bucket in used:
            d = bucket >> bits
            if d not in layer["blocks"]:
                layer["blocks"][d] = [self.block(layer) for _ in range(rng.choice([0, 0, 1, 2]))]
            blocks = layer["blocks"][d]
            block = rng.randrange(len(blocks)) if blocks and rng.random() < 0.8 else sb.NO_BLOCK
            for _ in range(rng.choice([1, 1, 2])):
                layer["pages"].append(self.page(layer, bucket, block))
        if not self.may_be_raw and rng.random() < 0.8:
            random_page.add_rans_pages(rng, self.scene, layer)
        layer["num_gaussians"] = sum(p["num_gaussians"] for p in layer["pages"])
        return layer

    def block(self, layer):
        rng, tables = self.rng, []
        for c, name in enumerate(sb.COMPONENTS, 1):
            if layer[name]["coding"] == VQ and layer[name].get("rcq") and rng.random() < 0.7:
                whole, residual = len(layer[name]["stages"][0]), len(layer[name]["rcq"])
                n = entries(rng)
                pairs = [(rng.randrange(whole), rng.randrange(residual)) for _ in range(n)]
                tables.append((c, n, sb.rcq_table(rng, pairs, whole, residual)))
        return tables

    def page(self, layer, bucket, block):
        rng = self.rng
        n = rng.choice([1, 2, 3, 7, 8, 9, 16, 31, 32, 33, 65])
        sizes = {} if block == sb.NO_BLOCK else {sb.COMPONENTS[c - 1]: k for c, k, _ in layer[
            "blocks"][bucket >> layer["directory_bits"]][block]}
        columns = random_page.Columns(rng, self.scene, layer, n, sizes)
        visible = sorted(rng.randrange(256) for _ in range(2))
        box = [f32(rng.uniform(-9, 9)) for _ in range(3)]
        bounds = struct.unpack("<6H", struct.pack("<6e", *box, *[b + 1 for b in box]))
        return {"num_gaussians": n, "bucket": bucket, "block": block, "visible_begin": visible[0],
                "visible_end": visible[1], "bounds": bounds, "reserved": rng.randrange(256),
                "columns": columns, "raw": columns.streams()}

    def build(self):
        flags = self.rng.choice([0, 1, 0x82])
        version = (1, self.rng.randrange(256))
        unknown_fields = self.rng.random() < 0.5
        return sb.build(self.scene, version, flags, self.rng, unknown_fields)

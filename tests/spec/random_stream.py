# SPDX-License-Identifier: Apache-2.0
"""Random valid scenes for stream_builder: codings, layers, blocks and stream forms in combinations
that the encoder does not choose. Only LAYR-1, DIR-9 and DIR-10, which decoders do not check, are
left to chance."""

import random
import struct

import stream_builder as sb

ZERO, RAW32, VQ = range(3)


def f32(x):
    return struct.unpack("<f", struct.pack("<f", x))[0]


def half_value(rng):
    return rng.choice([0.0, -0.0, 1.0, 2.0 ** -24, -65504.0, rng.uniform(-4, 4), rng.gauss(0, 0.1)])


def raw_value(rng):
    return rng.choice([0.0, -0.0, f32(3.0e38), f32(1e-3), f32(rng.gauss(0, 1)),
                       f32(rng.uniform(-50, 50))])


def rows(rng, n, dim):
    round16 = lambda v: struct.unpack("<e", struct.pack("<e", v))[0]
    return [[round16(half_value(rng)) for _ in range(dim)] for _ in range(n)]


def entries(rng):
    return rng.choice([1, 2, 3, 4, 5, 16, 17, 33])


def component(rng, dim, may_be_raw=True, may_have_rcq=False):
    coding = rng.choice([ZERO, RAW32, VQ, VQ, VQ, VQ] if may_be_raw else [ZERO, VQ, VQ, VQ])
    if coding != VQ:
        return {"coding": coding}
    out = {"coding": VQ, "literals": rng.random() < 0.4,
           "stages": [rows(rng, entries(rng), dim) for _ in range(rng.choice([1, 1, 2, 3, 8]))]}
    if may_have_rcq and rng.random() < 0.6:
        out["rcq"] = rows(rng, entries(rng), dim)
    return out


def scalar(rng, may_be_raw=True):
    coding = rng.choice([0, 1, 2, 2, 2] if may_be_raw else [0, 2, 2])
    number = lambda: f32(rng.choice([0.0, rng.uniform(-2, 2), 2.0 ** -60, 2.0 ** 40]))
    return {"coding": coding, "bits": rng.randint(1, 16), "offset": number(), "step": number()}


class RandomScene:
    def __init__(self, seed):
        self.rng = rng = random.Random(seed)
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
            "position": rng.choice([1, 2, 2]),
            "position_center": {k: f32(rng.choice([0.0, rng.uniform(-9, 9), -2.0 ** 60]))
                                for k in "xyz"},
            "position_scale": f32(rng.choice([1.0, 0.37, 2.0 ** -60, 2.0 ** 60])),
            "opacity": scalar(rng), "sh_degree": degree, "sh": component(rng, self.sh_dim),
            "metadata": [{"key": "a", "value": "\u00e4"}] * rng.randint(0, 2),
            "extensions": [{"id": 70000, "critical": False}] * rng.randint(0, 1),
        }
        levels = sb.bit_width(self.frames) + 1
        layers = rng.randint(1, min(4, 2 * levels))
        chosen = sorted(rng.randrange(levels) for _ in range(layers))
        self.scene["layers"] = [self.layer(level) for level in chosen]
        self.scene["num_gaussians"] = sum(la["num_gaussians"] for la in self.scene["layers"])

    def layer(self, level):
        rng = self.rng
        permanent = level == 0 and rng.random() < 0.5
        layer = {"level": level, "permanent": permanent,
                 "mean_t": 0 if permanent else rng.choice([1, 2, 2]),
                 "log_scale_t": f32(rng.uniform(-3, 9)),
                 "scale_factor": scalar(rng, may_be_raw=False),
                 "scale": component(rng, 3 if permanent else 4, may_have_rcq=level > 0),
                 "rotor_spatial": component(rng, 4, may_have_rcq=level > 0)}
        may_be_raw = layer["rotor_spatial"]["coding"] == RAW32
        layer["rotor_temporal"] = component(rng, 4, may_be_raw, level > 0)
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
        layer["num_gaussians"] = sum(p["num_gaussians"] for p in layer["pages"])
        return layer

    def block(self, layer):
        rng, tables = self.rng, []
        for c, name in enumerate(sb.COMPONENTS, 1):
            if layer[name].get("rcq") and rng.random() < 0.7:
                whole, residual = len(layer[name]["stages"][0]), len(layer[name]["rcq"])
                n = entries(rng)
                pairs = [(rng.randrange(whole), rng.randrange(residual)) for _ in range(n)]
                tables.append((c, n, sb.rcq_table(rng, pairs, whole, residual)))
        return tables

    def page(self, layer, bucket, block):
        rng = self.rng
        n = rng.choice([1, 2, 3, 7, 8, 9, 16, 33])
        sizes = {} if block == sb.NO_BLOCK else {c: k for c, k, _ in layer["blocks"][
            bucket >> layer["directory_bits"]][block]}
        raw = b"".join([
            *[self.mean(self.scene["position"], n) for _ in range(3)],
            self.mean(layer["mean_t"], n),
            self.scalars(self.scene["opacity"], n), self.scalars(layer["scale_factor"], n),
            self.vectors(self.scene["sh"], self.sh_dim, n, None),
            *[self.vectors(layer[name], 3 if name == "scale" and layer["permanent"] else 4, n,
                           sizes.get(c)) for c, name in enumerate(sb.COMPONENTS, 1)]])
        visible = sorted(rng.randrange(256) for _ in range(2))
        box = [f32(rng.uniform(-9, 9)) for _ in range(3)]
        bounds = struct.unpack("<6H", struct.pack("<6e", *box, *[b + 1 for b in box]))
        return {"num_gaussians": n, "bucket": bucket, "block": block, "visible_begin": visible[0],
                "visible_end": visible[1], "bounds": bounds, "reserved": rng.randrange(256),
                "raw": raw}

    def mean(self, coding, n):
        if coding == 2:
            return sb.halves(self.rng, [half_value(self.rng) for _ in range(n)])
        return self.raw(n) if coding == 1 else b""

    def raw(self, n):
        return sb.stream(self.rng, [sb.order32(raw_value(self.rng)) for _ in range(n)], 32)

    def scalars(self, coding, n):
        if coding["coding"] == 1:
            return self.raw(n)
        if coding["coding"] == 0:
            return b""
        return sb.stream(self.rng, [self.rng.randrange(1 << coding["bits"]) for _ in range(n)],
                         coding["bits"])

    def vectors(self, coding, dim, n, block_entries):
        rng = self.rng
        if coding["coding"] != VQ:
            return b"".join(self.raw(n) for _ in range(dim)) if coding["coding"] == RAW32 else b""
        stages = len(coding["stages"])
        out, depth = b"", [stages] * n
        if stages > 1 or coding["literals"]:
            depth = [rng.choice([*range(stages + 1)] + [15] * coding["literals"]) for _ in range(n)]
            out += sb.stream(rng, depth, 4)
        for s, book in enumerate(coding["stages"]):
            limit = block_entries if s == 0 and block_entries is not None else len(book)
            count = sum(1 for d in depth if s < d < 15)
            out += sb.stream(rng, [rng.randrange(limit) for _ in range(count)], sb.bit_width(limit))
        for _ in range(dim):
            out += sb.halves(rng, [half_value(rng) for d in depth if d == 15])
        return out

    def build(self):
        flags = self.rng.choice([0, 1, 0x82])
        version = (1, self.rng.randrange(256))
        unknown_fields = self.rng.random() < 0.5
        return sb.build(self.scene, version, flags, self.rng, unknown_fields)

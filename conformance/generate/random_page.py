# SPDX-License-Identifier: Apache-2.0
"""Random columns of a page, and both forms in which a page can hold them."""

import struct

import rans_writer
import stream_builder as sb
from arithmetic import half, unorder
from legal import NoLegalValue
from make_tiny import order
from header import has_fine_mean_times, window_columns
from rans_writer import Channel
from times import phases_of_window, window_base, window_times

ZERO, RAW32, VQ, TRANSFORM = range(4)
NONE, _, F16, FIXED, RAW64, WINDOW = range(6)
SH = "sh"


def f32(x):
    return struct.unpack("<f", struct.pack("<f", x))[0]


def half_value(rng):
    return rng.choice([0.0, -0.0, 1.0, 2.0 ** -24, -65504.0, rng.uniform(-4, 4), rng.bell(0.1)])


def raw_value(rng):
    return rng.choice([0.0, -0.0, f32(3.0e38), f32(1e-3), f32(rng.bell(1)),
                       f32(rng.uniform(-50, 50))])


def raw_opacity(rng):
    return rng.choice([0.0, -0.0, 1.0, f32(rng.random())])


def raw_log_scale(rng, most):
    """most: a Gaussian whose log scales are no greater fits its layer."""
    return rng.choice([v for v in (0.0, -0.0, 17.0, -17.0) if v <= most] +
                      [f32(rng.uniform(-17, max(most, -17.0)))] * 2)


def vector_length(scene, layer, name):
    if name == SH:
        return 3 * (scene["sh_degree"] + 1) ** 2
    if name == "scale":
        return 3 if layer["permanent"] else 4
    return 3 if layer[name]["coding"] == TRANSFORM else 4


def morton(x, y, z):
    return sum((v >> b & 1) << 3 * b + j for j, v in enumerate((x, y, z)) for b in range(21))


class Columns:
    """window: the bucket that the page is of. stage0: component -> entries of the block codebook.
    shown: the times in which each Gaussian may be visible. flat: [(name, bits, values)] of the columns of
    flat windows."""

    def __init__(self, rng, scene, layer, n, window, stage0):
        self.rng, self.scene, self.layer, self.n, self.window = rng, scene, layer, n, window
        self.position = [self.coordinates() for _ in range(3)]
        self.shown = []
        self.flat = self.windows() if layer["mean_t"] == WINDOW else []
        drawn = [self.mean_time() for _ in range(n)] if layer["mean_t"] not in (NONE, WINDOW) else []
        self.mean_t, fine, means = ([d[k] for d in drawn] for k in range(3))
        self.shown += [(mean - window.reach, mean + window.reach) for mean in means]
        self.mean_t_fine = fine if has_fine_mean_times(layer) else []
        self.opacity = self.scalars(scene["opacity"], raw_value if scene.get("opacity_logit") else
                                    raw_opacity)
        self.factor = self.scalars(layer["scale_factor"])
        self.component = {name: self.vectors(name, stage0.get(name))
                          for name in (SH, *sb.COMPONENTS)}

    def coding(self, name):
        return self.scene[SH] if name == SH else self.layer[name]

    def position_coding(self):
        return RAW32 if self.layer.get("raw_position") else self.scene["position"]

    def coordinates(self):
        rng, coding = self.rng, self.position_coding()
        if coding == RAW32:
            return self.raw()
        if coding == FIXED:
            top = (1 << self.scene["position_bits"]) - 1
            return [rng.choice([0, top, rng.randint(0, top)]) for _ in range(self.n)]
        return [order(half_value(rng)) for _ in range(self.n)]

    def windows(self):
        rows = []
        for _ in range(self.n):
            begin, end = self.flat_window()
            self.shown.append(window_times(self.scene, (begin, end)))
            length = end - begin - self.layer["window_length"]
            begin -= window_base(self.scene, self.window.level, self.window.bucket)
            rows.append((begin & 0xFFFF, begin >> 16, length & 0xFFFF, length >> 16))
        return [(name, bits, list(values))
                for (name, bits), values in zip(window_columns(self.layer), zip(*rows) if rows else [()] * 4) if bits]

    def flat_window(self):
        """(begin, end), frames, legal in the bucket"""
        rng, layer, frames = self.rng, self.layer, self.scene["num_frames"]
        base = window_base(self.scene, self.window.level, self.window.bucket)
        least = layer["window_length"]
        most_begin = min((1 << layer["window_begin_bits"]) - 1, frames - 1 - base, self.window.begins(frames))
        for _ in range(400):
            begin = base + rng.randint(0, most_begin)
            most = min((1 << layer["window_length_bits"]) - 1, frames - begin - least)
            end = begin + least + rng.choice([1 - least, most, rng.randint(1 - least, most)])
            if self.window.holds(phases_of_window(self.scene, (begin, end))):
                return begin, end
        raise NoLegalValue

    def mean_time(self):
        """(code, refinement, about the mean time), legal in the bucket"""
        for _ in range(400):
            code, fine, mean = self.drawn_mean_time()
            if mean is not None and self.window.allows(mean):
                return code, fine, mean
        raise NoLegalValue

    def drawn_mean_time(self):
        rng, layer, window = self.rng, self.layer, self.window
        coding, fine = layer["mean_t"], 0
        near = window.center + rng.uniform(-0.7, 0.7) * window.width
        if coding == RAW64:
            mean = rng.choice([near, near, 0.0, -0.0, 2.0 ** 60, -2.0 ** 60, 1.7e9 + rng.random()])
            return sb.order64(mean), 0, mean
        if coding == RAW32:
            mean = f32(rng.choice([near, near, near, raw_value(rng)]))
            return sb.order32(mean), 0, mean
        if coding == F16:
            shift = layer["mean_t_shift"]
            drawn = rng.choice([half_value(rng), rng.uniform(-0.7, 0.7)])
            code = order(drawn) >> shift
            value = half(unorder((code << shift) + (1 << shift >> 1), 16))
            return code, 0, window.center + window.width * value if abs(value) < 65536 else None
        top = (1 << layer["mean_t_bits"]) - 1
        code = rng.choice([0, top, rng.randint(0, top), min(layer["mean_t_zero"], top)])
        part = 0.0
        if layer["mean_t_fine"]:
            fine = rng.choice([0, 0, 1, 2, 65535, rng.randrange(1 << 16)])
            bits = (fine + 1).bit_length() - 1
            part = (fine + 1 - (1 << bits) + 0.5) / (1 << bits) - 0.5
        return code, fine, window.center + layer["mean_t_step"] * (code - layer["mean_t_zero"] + part)

    def raw(self, value=raw_value):
        return [sb.order32(value(self.rng)) for _ in range(self.n)]

    def scalars(self, coding, value=raw_value):
        if coding["coding"] == RAW32:
            return self.raw(value)
        bits = coding["bits"] if coding["coding"] == 2 else 0
        return [self.rng.randrange(1 << bits) for _ in range(self.n)] if bits else []

    def vectors(self, name, stage0):
        """{what a section of section 13.1 is called: its values}"""
        rng, coding, layer, n = self.rng, self.coding(name), self.layer, self.n
        dim = vector_length(self.scene, self.layer, name)
        if coding["coding"] == RAW32:
            most = 17.0 if layer["level"] == 0 else self.window.most_log_scale()
            value = (lambda r: raw_log_scale(r, most)) if name == "scale" else raw_value
            return {"raw": [self.raw(value) for _ in range(dim)]}
        if coding["coding"] == VQ:
            stages = len(coding["stages"])
            choices = [*range(stages + 1)] + [15] * coding["escapes"]
            told = stages > 1 or coding["escapes"]
            depth = [rng.choice(choices) if told else stages for _ in range(n)]
            sizes = [stage0 or len(coding["stages"][0]), *map(len, coding["stages"][1:])]
            index = [[rng.randrange(size) for d in depth if k < d < 15]
                     for k, size in enumerate(sizes)]
            escape = [[order(half_value(rng)) for d in depth if d == 15] for _ in range(dim)]
            return {"depth": depth if told else None, "sizes": sizes, "index": index,
                    "escape": escape}
        if coding["coding"] == TRANSFORM:
            eob_table = [0, *coding["eob_table"]]
            most = rng.choice([0, 3, 15, 15])
            step_exponents = [rng.randint(0, most) for _ in range(n)]
            eob_indices = [rng.randrange(len(eob_table)) if len(eob_table) > 2 else 1 for _ in range(n)]
            who = [[i for i in range(n) if eob_table[eob_indices[i]] > k]
                   for k in range(len(coding["steps"]))]
            return {"step_exponent": step_exponents, "eob_index": eob_indices if len(eob_table) > 2 else None,
                    "eob_indices": len(eob_table), "who": who,
                    "coefficient": [[self.coefficient() for _ in w] for w in who]}
        return {}

    def coefficient(self):
        rng = self.rng
        return rng.choice([0, 0, 1, -1, rng.randint(-8, 8), rng.randint(-200, 200), 32767, -32768])

    # ---- streams ---------------------------------------------------------------------------------

    def streams(self):
        rng, scene, layer = self.rng, self.scene, self.layer
        width = 16 if self.position_coding() == F16 else 32
        out = b"".join(sb.stream(rng, v, width) for v in self.position)
        if layer["mean_t"] == RAW64:
            out += sb.stream(rng, [v >> 32 for v in self.mean_t], 32)
            out += sb.stream(rng, [v & 0xFFFFFFFF for v in self.mean_t], 32)
        else:
            out += sb.stream(rng, self.mean_t,
                             16 - layer["mean_t_shift"] if layer["mean_t"] == F16 else
                             layer["mean_t_bits"] if layer["mean_t"] == FIXED else 32)
        out += sb.stream(rng, self.mean_t_fine, 16)
        out += b"".join(sb.stream(rng, values, bits) for _, bits, values in self.flat)
        for coding, values in ((scene["opacity"], self.opacity),
                               (layer["scale_factor"], self.factor)):
            out += sb.stream(rng, values, coding["bits"] if coding["coding"] == 2 else 32)
        return out + b"".join(self.component_streams(c) for c in self.component.values())

    def component_streams(self, c):
        stream, out = lambda values, width: sb.stream(self.rng, values, width), b""
        out += b"".join(stream(v, 32) for v in c.get("raw", []))
        if "index" in c:
            out += stream(c["depth"] or [], 4)
            out += b"".join(stream(v, sb.bit_width(k)) for v, k in zip(c["index"], c["sizes"]))
            out += b"".join(stream(v, 16) for v in c["escape"])
        if "step_exponent" in c:
            out += stream(c["step_exponent"], 4) + stream(c["eob_index"] or [], sb.bit_width(c["eob_indices"]))
            out += b"".join(stream(list(map(zigzag, v)), 16) for v in c["coefficient"])
        return out

    # ---- channels ----------------------------------------------------------------------------------

    def channels(self):
        codes = sorted(morton(*p) for p in zip(*self.position))
        gaps = [a - b for a, b in zip(codes, [0, *codes])]
        out = [Channel("position", gaps, wide=True)]
        for name, there, values in (
                ("mean_t", self.layer["mean_t"] not in (NONE, WINDOW), self.mean_t),
                ("mean_t_fine", has_fine_mean_times(self.layer), self.mean_t_fine),
                *[(name, True, values) for name, _, values in self.flat],
                ("opacity", self.scene["opacity"]["coding"] == 2, self.opacity),
                ("scale_factor", self.layer["scale_factor"]["coding"] == 2, self.factor)):
            out += [Channel(name, values)] * there
        before = [0] * self.n
        for name in (*sb.COMPONENTS, SH):
            c, of = self.component[name], self.coding(name)
            if "index" in c:
                out += [Channel(f"{name} depth", c["depth"] or [])] * (c["depth"] is not None)
                out += [Channel(f"{name} index", v) for v in c["index"]]
                out += [Channel(f"{name} escape", v) for v in c["escape"]] if of["escapes"] else []
            if "step_exponent" in c:
                step_exponents = c["step_exponent"]
                out.append(Channel(f"{name} step exponent", step_exponents, before, 16))
                if c["eob_index"] is not None:
                    out.append(Channel(f"{name} EOB index", c["eob_index"], step_exponents, 16))
                out += self.coefficient_channels(name, c)
                before = step_exponents
        return out

    def coefficient_channels(self, name, c):
        out, history = [], [[0, 0] for _ in range(self.n)]
        for k, (who, values) in enumerate(zip(c["who"], c["coefficient"])):
            contexts = []
            for i, q in zip(who, values):
                a = abs(history[i][-1]) + abs(history[i][-2])
                m = sum(a >= limit for limit in (1, 3, 7, 15))
                contexts.append(5 * c["step_exponent"][i] + m if k else c["step_exponent"][i])
                history[i].append(q)
            out.append(Channel(f"{name} coefficient", list(map(zigzag, values)), contexts,
                             80 if k else 16))
        return out


def zigzag(q):
    return 2 * q if q >= 0 else -2 * q - 1


def add_rans_pages(rng, scene, layer, all_pages=False):
    """Gives the layer its entropy chunk, and its pages, or most of them, their bytes."""
    names = [(p.name, p.num_contexts, p.wide) for p in Columns(rng, scene, layer, 0, None, {}).channels()]
    chosen = [p for p in layer["pages"] if all_pages or rng.random() < 0.8]
    channels = [p["columns"].channels() for p in chosen]
    model = rans_writer.Model(rng, names, channels)
    layer["entropy"] = model.chunk
    for page, of in zip(chosen, channels):
        detail = rans_writer.first_detail(of, scene["sh_base"]) if rng.random() < 0.6 else None
        page["codec"], (page["raw"], page["detail"]) = 2, model.page(of, detail)

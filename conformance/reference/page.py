# SPDX-License-Identifier: Apache-2.0
"""Pages, section 13 of spec/l4d.md: columns of integers, of either form."""

from arithmetic import bit_width, located, require, unorder, unzigzag
from file import RANS32, STORED, ZSTD
from header import (CONSTANT, COMPONENTS, F16, FIXED, NONE, RAW32, RAW64, ROTOR_SPATIAL,
                    ROTOR_TEMPORAL, SCALE, SH, TRANSFORM, VQ, WINDOW, component, has_depth,
                    has_fine_mean_times, position_coding, vector_length, window_columns)
from rans import RansPage, codable, coefficient_context
from streams import Streams
from times import window_base

ESCAPE = 15                        # a depth


class StreamPage(Streams):
    """A page whose codec is 0 or 1."""

    order = (SH, SCALE, ROTOR_SPATIAL, ROTOR_TEMPORAL)

    def positions(self, n, width):
        """x, y and z: f16, or fixed of `width` bits."""
        limit = 0 if self.stored_width == 16 else 1 << width
        return [self.read(n, self.stored_width, f"position {axis}", limit, "STRM-3")
                for axis in "xyz"]


def page_streams(file, codebooks, index, record, base_only):
    """What the columns of a page are read from."""
    h = codebooks.header
    numbers = 17 + vector_length(h, index, SH)
    most = record["num_gaussians"] * (4 * numbers + 72) + 32 * (numbers + 36)
    first = file.chunk(record, most, h["payload_offset"], (STORED, ZSTD, RANS32))
    if record["codec"] != RANS32:
        streams = StreamPage(file, first)
        streams.stored_width = 32 if position_coding(h, index) == FIXED else 16
        return streams
    require(h["layers"][index]["entropy"] is not None and codable(h, index), "RANS-6",
            "a rans32 page", first.at)
    detail, size = None, record["sh_bytes"]
    if size > 0 and not base_only:
        detail = file.chunk({"offset": record["sh_offset"], "hash": record["sh_hash"],
                             "stored_bytes": size, "raw_bytes": size, "codec": STORED}, most,
                            h["payload_offset"])
    return RansPage(file, first, detail, codebooks.entropy(index), size > 0)


class Page:
    """The columns of a page. mean_t, mean_t_fine, opacity and scale_factor are None where the page
    has none; components are dictionaries by number, what a page leaves out is absent.

      position    x, y, z: ordered binary16, fixed or, where raw32, bits of binary32
      mean_t      codes; bits of binary32 or binary64 where raw; None where there are windows
      window      (begin, end), frames; None where there are mean times or neither
      opacity, scale_factor   codes, or bits of binary32
      component   {"depth", "index", "escape"}, {"step_exponent", "eob_index", "coefficient"} or {"raw"}
    """

    def __init__(self, file, codebooks, index, record, block_codebooks, base_only=False):
        """block_codebooks: of the page's block. base_only: leaves out the SH chunk."""
        self.header, self.index, self.n = codebooks.header, index, record["num_gaussians"]
        self.record, self.layer = record, codebooks.header["layers"][index]
        self.has_sh = not (base_only and record["sh_bytes"] > 0)      # all of it
        self.in_detail = record["sh_bytes"] > 0
        self.streams = page_streams(file, codebooks, index, record, base_only)
        self.position = self.positions()
        self.window = self.windows() if self.layer["mean_t"] == WINDOW else None
        self.mean_t, self.mean_t_fine = self.mean_times()
        self.opacity = self.scalars(self.header["opacity"], "opacity")
        self.scale_factor = self.scalars(self.layer["scale_factor"], "scale_factor")
        self.component, self.step_exponents = {}, [0] * self.n
        for c in self.streams.order:
            if c == SH and not self.has_sh and self.header["sh_base"] == 0:
                continue
            coding = component(self.header, index, c)["coding"]
            self.component[c] = (self.vq(c, block_codebooks.get(c)) if coding == VQ else
                                 self.transform(c) if coding == TRANSFORM else
                                 self.raw_vectors(c) if coding == RAW32 else {})
        self.streams.end()
        self.symbols = self.streams.symbols

    def raw(self, what):
        """Bits of finite binary32."""
        place = self.streams.place()
        bits = [unorder(v, 32) for v in self.streams.read(self.n, 32, what)]
        require(all(b & 0x7FFFFFFF < 0x7F800000 for b in bits), "VAL-3", f"{what} is not finite", place)
        return bits

    def raw_vectors(self, c):
        dim = vector_length(self.header, self.index, c)
        return {"raw": [self.raw(f"{COMPONENTS[c]}, number {d}") for d in range(dim)]}

    def positions(self):
        coding = position_coding(self.header, self.index)
        if coding == RAW32:
            return [self.raw(f"position {axis}") for axis in "xyz"]
        place = self.streams.place()
        columns = self.streams.positions(
            self.n, int(self.header["position_bits"]) if coding == FIXED else 16)
        for column in columns:
            require(coding != F16 or all(map(is_finite, column)), "VAL-1", "position", place)
        return columns

    def windows(self):
        place = self.streams.place()
        columns = [self.streams.read(self.n, bits, name) if bits else [0] * self.n
                   for name, bits in window_columns(self.layer)]
        base = window_base(self.header, self.layer["level"], self.record["bucket"])
        out = []
        for low, high, length, length_high in zip(*columns):
            begin = base + low + (high << 16)
            end = begin + self.layer["window_length"] + length + (length_high << 16)
            require(begin < end <= self.header["num_frames"], "WIND-3", f"{begin} to {end}", place)
            out.append((begin, end))
        return out

    def mean_times(self):
        layer, read, n, place = self.layer, self.streams.read, self.n, self.streams.place()
        if layer["mean_t"] in (NONE, WINDOW):
            return None, None
        if layer["mean_t"] == RAW32:
            return self.raw("mean_t"), None
        if layer["mean_t"] == RAW64:
            high, low = read(n, 32, "mean_t high"), read(n, 32, "mean_t low")
            return [unorder(a << 32 | b, 64) for a, b in zip(high, low)], None
        if layer["mean_t"] == F16:
            shift = int(layer["mean_t_shift"])
            codes = read(n, 16 - shift, "mean_t")
            require(all(is_finite(ordered_mean_time(code, shift)) for code in codes), "VAL-1", "mean_t",
                    place)
            return codes, None
        codes = read(n, int(layer["mean_t_bits"]), "mean_t")
        return codes, read(n, 16, "mean_t_fine") if has_fine_mean_times(layer) else None

    def scalars(self, coding, what):
        if coding["coding"] == CONSTANT:
            return None
        if coding["coding"] == RAW32:
            return self.raw(what)
        return self.streams.read(self.n, int(coding["bits"]), what)

    def vq(self, c, block_codebook):
        coding, name, n = component(self.header, self.index, c), COMPONENTS[c], self.n
        stages, read = len(coding["stages"]), self.streams.read
        depth = [stages] * n
        if has_depth(coding):
            place = self.streams.place()
            depth = read(n, 4, f"{name} depth")
            for d in depth:
                require(d <= stages or d == ESCAPE and coding["escapes"], "VQ-1", f"depth {d}", place)
        index = []
        for s, stage in enumerate(coding["stages"]):
            entries = len(block_codebook) if s == 0 and block_codebook else stage["num_entries"]
            count = sum(s < d != ESCAPE for d in depth)
            index.append(read(count, bit_width(entries), f"{name} index, stage {s}", entries, "VQ-2"))
        escape = []
        for d in range(vector_length(self.header, self.index, c) if coding["escapes"] else 0):
            place = self.streams.place()
            escape.append(read(depth.count(ESCAPE), 16, f"{name} escape, number {d}"))
            require(all(map(is_finite, escape[-1])), "VAL-2", f"{name} escape", place)
        return {"depth": depth, "index": index, "escape": escape}

    def transform(self, c):
        coding, name, n = component(self.header, self.index, c), COMPONENTS[c], self.n
        read, eob_table = self.streams.read, [0, *coding["eob_table"]]
        clause = "TRAN-5" if isinstance(self.streams, RansPage) else "STRM-3"
        step_exponents = read(n, 4, f"{name} step exponent", 16, clause, self.step_exponents)
        eob_indices = [1] * n
        if len(eob_table) > 2:
            eob_indices = read(n, bit_width(len(eob_table)), f"{name} EOB index", len(eob_table), "TRAN-6", step_exponents)
        coefficients = [[] for _ in range(n)]
        number = len(coding["steps"])
        if c == SH and not self.has_sh:
            number = int(self.header["sh_base"])
        for k in range(number):
            who = [i for i in range(n) if eob_table[eob_indices[i]] > k]
            contexts = [coefficient_context(step_exponents[i], coefficients[i]) for i in who]
            coded = read(len(who), 16, f"{name} coefficient {k}", contexts=contexts)
            for i, z in zip(who, coded):
                coefficients[i].append(unzigzag(z))
        self.step_exponents = step_exponents
        return {"step_exponent": step_exponents, "eob_index": eob_indices, "coefficient": coefficients}


def is_finite(ordered):
    """Of an ordered binary16."""
    return unorder(ordered, 16) & 0x7FFF < 0x7C00


def ordered_mean_time(code, shift):
    """The ordered binary16 that an f16 mean time stands for."""
    return (code << shift) + (1 << shift >> 1)

# SPDX-License-Identifier: Apache-2.0
"""Profiles and conformance levels, section 18 of spec/l4d.md.

Plain sums over all phases at which something changes, in exact arithmetic."""

from fractions import Fraction

from arithmetic import Invalid, require
from header import COMPONENTS, F16, FIXED, RAW32, RAW64, SH, TRANSFORM, VQ, WINDOW
from rans import page_channels
from times import directory_pages, num_buckets, phase_of_time, visible_interval

MI = 1 << 20
INDEXED, MAIN, LOSSLESS = 1, 2, 3
# G, C, I, H, R, B, M, S, W
LEVELS = {1: (100000, 32 * MI, 4 * MI, 8 * MI, 2 * MI, 4 * MI, 64 * MI, 6400000, 3200000),
          2: (250000, 48 * MI, 8 * MI, 16 * MI, 4 * MI, 8 * MI, 128 * MI, 16000000, 8000000),
          3: (500000, 64 * MI, 16 * MI, 32 * MI, 8 * MI, 16 * MI, 256 * MI, 32000000, 16000000),
          4: (1000000, 128 * MI, 32 * MI, 64 * MI, 16 * MI, 32 * MI, 512 * MI, 64000000, 32000000),
          5: (2500000, 256 * MI, 96 * MI, 192 * MI, 48 * MI, 96 * MI, 1024 * MI,
              160000000, 80000000),
          6: (8000000, 512 * MI, 256 * MI, 512 * MI, 128 * MI, 256 * MI, 3072 * MI,
              512000000, 256000000)}


def keeps_profile(h, profile):
    # Of main, layers whose positions are raw32 may be raw32 in everything.
    layers = [la for la in h["layers"] if profile != MAIN or not la["raw_position"]]
    components = [h["sh"]] + [la[name] for la in layers for name in COMPONENTS[1:]]
    codings = [c["coding"] for c in components]
    means = [RAW32 if la["mean_t"] == RAW64 else la["mean_t"] for la in layers]
    if profile == LOSSLESS:
        times = [c for c in means if c != WINDOW]
        return all(c == RAW32 for c in codings + times + [h["position"], h["opacity"]["coding"]])
    scalars = [h["opacity"]["coding"]] + [la["scale_factor"]["coding"] for la in layers]
    if RAW32 in codings + means + scalars:
        return False
    if profile == INDEXED:
        return (h["position"] == F16 and TRANSFORM not in codings and FIXED not in means and
                not any(la["raw_position"] for la in layers))
    return h["position"] in (F16, FIXED)


def most_symbols(h, index):
    """E of section 18.2."""
    layer = h["layers"][index]
    return 0 if layer["entropy"] is None else layer["symbols_per_gaussian"] or len(page_channels(h, index))


class Demand:
    """What playing a stream asks for."""

    def __init__(self, decoder, head_bytes):
        self.decoder, self.h = decoder, decoder.header
        self.chunks = []        # first, last, Gaussians, stored bytes, memory, symbols
        self.others = []        # first, stored bytes: of the directory
        self.table_bytes, self.head_bytes = 0, head_bytes
        self.tables()
        for index, layer in enumerate(self.h["layers"]):
            if layer["num_gaussians"] > 0:
                self.layer(index, layer)
        first = [(c[0], c[3]) for c in self.chunks] + self.others
        self.start_bytes = self.head_bytes + sum(n for phase, n in first if phase == 0)
        self.later = self.first_needed_later(first)
        self.later_symbols = self.first_needed_later([(c[0], c[5]) for c in self.chunks])
        peaks = [[sum(c[k] for c in self.chunks if c[0] <= at[0] <= c[1]) for k in (2, 3, 4, 5)]
                 for at in self.chunks] or [[0, 0, 0, 0]]
        self.gaussians, self.instant_bytes, memory, self.symbols = map(max, zip(*peaks))
        self.memory_bytes = self.table_bytes + memory

    @staticmethod
    def first_needed_later(first):
        """{phase: sum of what is first needed there}, without phase 0."""
        later = {}
        for phase, n in first:
            if phase > 0:
                later[phase] = later.get(phase, 0) + n
        return later

    def tables(self):
        def component(index, c):
            coding = self.decoder.component(index, c)
            stages = list(coding["stages"] or ()) if coding["coding"] == VQ else []
            if coding["coding"] == VQ and coding["rcq"] is not None:
                stages.append(coding["rcq"])
            if coding["coding"] == TRANSFORM:
                stages.append(coding["basis"])
            for s in stages:
                self.table_bytes += 4 * s["num_entries"] * self.decoder.dim(index, c)
                self.head_bytes += s["codebook"]["stored_bytes"]
        component(0, SH)
        for index, layer in enumerate(self.h["layers"]):
            for c in (1, 2, 3):
                component(index, c)
            if layer["entropy"] is not None:
                self.table_bytes += 1 << 19
                self.head_bytes += layer["entropy"]["stored_bytes"]

    def needed(self, layer, record):
        """First and last phase, or None."""
        h, k, buckets = self.h, record["bucket"], num_buckets(layer["level"])
        stride = (1 << 40) // buckets
        first = max(k - 1, 0) * stride
        last = (min(k + 1, buckets - 1) + 1) * stride - 1
        if not layer["permanent"]:
            begin, end = visible_interval(h, layer["level"], record)
            if record["visible_begin"] > 0:
                if begin > h["time_begin"] + self.decoder.duration:
                    return None
                first = max(first, phase_of_time(h, begin))
            if record["visible_end"] < 255:
                if end < h["time_begin"]:
                    return None
                last = min(last, phase_of_time(h, end))
        return (first, last) if first <= last else None

    def layer(self, index, layer):
        bits, level = int(layer["directory_bits"]), layer["level"]
        stride = (1 << 40) // num_buckets(level)
        numbers = 17 + self.decoder.dim(index, SH)
        symbols = most_symbols(self.h, index)
        for d in range(directory_pages(level, bits)):
            stored = self.decoder.directory.entry(index, d)["stored_bytes"]
            self.others.append((max((d << bits) - 1, 0) * stride, 32 + stored))
            page = self.decoder.directory.page(index, d)
            if page is None:
                continue
            of_block = {}
            for r in page["pages"]:
                run = self.needed(layer, r)
                if run is None:
                    continue
                n = r["num_gaussians"]
                stored = r["stored_bytes"] + r["sh_bytes"]
                self.chunks.append((*run, n, stored, 4 * n * numbers, n * symbols))
                of_block.setdefault(r["block"], []).append(run)
            for b, block in enumerate(page["blocks"] or ()):
                runs = of_block.get(b)
                if runs:
                    self.chunks.append((
                        min(r[0] for r in runs), max(r[1] for r in runs), 0,
                        sum(t["table"]["stored_bytes"] for t in block["tables"]),
                        sum(4 * t["num_entries"] * self.decoder.dim(index, t["component"])
                            for t in block["tables"]), 0))

    def burst(self, rate, later=None):
        """The least B that a rate leaves: what a bucket holds at most that what is first needed fills, and
        that leaks at the rate. later: bytes, if nothing else is given."""
        later = self.later if later is None else later
        # In units of which `unit` are a byte, so that all numbers are integers.
        unit = self.h["fps_num"] << 40
        leak = rate * self.h["num_frames"] * self.h["fps_den"]
        most = held = before = 0
        for phase in sorted(later):
            held = max(held - leak * (phase - before), 0) + later[phase] * unit
            most, before = max(most, held), phase
        return Fraction(most, unit)

    def level(self):
        """The least level whose limits the stream keeps, 0 if none."""
        for level in LEVELS:
            try:
                self.check_level(level)
            except Invalid:
                continue
            return level
        return 0

    def check_level(self, level):
        g, c, i, start, rate, burst, memory, symbols, symbol_rate = LEVELS[level]
        factor = 8 if keeps_profile(self.h, LOSSLESS) else 1
        require(self.gaussians <= g, "LEVL-3", f"{self.gaussians} Gaussians")
        require(self.table_bytes <= c, "LEVL-4", f"{self.table_bytes} bytes of tables")
        require(self.instant_bytes <= factor * i, "LEVL-5", f"{self.instant_bytes} bytes")
        require(self.start_bytes <= factor * start, "LEVL-6", f"{self.start_bytes} bytes at first")
        require(self.burst(factor * rate) <= factor * burst, "LEVL-7", "bytes beyond the rate")
        require(self.memory_bytes <= memory, "LEVL-8", f"{self.memory_bytes} bytes of memory")
        require(self.symbols <= symbols, "LEVL-10", f"{self.symbols} symbols")
        require(self.burst(symbol_rate, self.later_symbols) <= symbols, "LEVL-11", "symbols beyond the rate")


def demand(decoder):
    return Demand(decoder, 40 + decoder.header_bytes)


def check(decoder):
    """Raises Invalid where what a stream declares is not so. decoder: a Decoder of it."""
    h = decoder.header
    require(h["profile"] <= LOSSLESS and h["conformance_level"] <= max(LEVELS), "LEVL-1", "ids")
    require(h["profile"] == 0 or keeps_profile(h, h["profile"]), "LEVL-2", "profile")
    if h["conformance_level"] > 0:
        demand(decoder).check_level(h["conformance_level"])

# SPDX-License-Identifier: Apache-2.0
"""rANS blocks, entropy chunks and rANS pages: sections 9.1, 10.2 and 13.2 of spec/l4d.md."""

import struct

from arithmetic import located, require
from header import (COMPONENTS, NONE, RAW32, RAW64, ROTOR_SPATIAL, ROTOR_TEMPORAL, SCALE, SH, SQ,
                    TRANSFORM, VQ, WINDOW, component, has_depth, has_fine_mean_times,
                    position_coding, vector_length, window_columns)
from streams import Streams

LANES = 32
SLOTS = 1024
LOW = 1 << 16
MAX_TABLES = 128
STEP_EXPONENTS = 16
MAGNITUDES = 5


def hybrid(token):
    """(least value, its raw bits in pieces) of a token."""
    if token < 16:
        return token, []
    e = (token - 16) >> 3
    return (8 + ((token - 16) & 7)) << (e + 1), [e + 1]


def wide(token):
    if token < 2:
        return token, []
    bits = (token >> 1) - 1
    return (2 + (token & 1)) << bits, [16] * (bits // 16) + [bits % 16] * (bits % 16 > 0)


class Block:
    """The channels of one rANS block, front to back."""

    def __init__(self, file, chunk, what):
        raw, base = chunk.raw, chunk.at       # such a chunk is stored as it is
        self.raw, self.base, self.at = raw, base, 4 * LANES
        require(len(raw) >= 4 * LANES, "RANS-1", f"a block of {len(raw)} bytes", base)
        file.claim(base, base + 4 * LANES, f"{what}: states of 32 lanes")
        if len(raw) > 4 * LANES:
            file.claim(base + 4 * LANES, base + len(raw), f"{what}: words")
        self.states = list(struct.unpack_from(f"<{LANES}I", raw))
        for lane, x in enumerate(self.states):
            require(x >= LOW, "RANS-3", f"state {x}", base + 4 * lane)

    def place(self):
        return self.base + self.at

    def refill(self, lane):
        if self.states[lane] < LOW:
            require(self.at + 2 <= len(self.raw), "RANS-7", "words are missing", self.place())
            word = int.from_bytes(self.raw[self.at:self.at + 2], "little")
            self.states[lane] = (self.states[lane] << 16) + word
            self.at += 2

    def channel(self, tables):
        """One integer for each of the tables."""
        values = []
        for group in range(0, len(tables), LANES):
            pieces = []
            for lane, table in enumerate(tables[group:group + LANES]):
                x = self.states[lane]
                token, begin, frequency = table.slots[x % SLOTS]
                self.states[lane] = frequency * (x >> 10) + x % SLOTS - begin
                self.refill(lane)
                value, bits = table.integer(token)
                values.append(value)
                pieces.append(bits)
            for piece in range(max(map(len, pieces))):
                for lane, bits in enumerate(pieces):
                    if piece < len(bits):
                        raw = self.states[lane] % (1 << bits[piece])
                        values[group + lane] += raw << sum(bits[:piece])
                        self.states[lane] >>= bits[piece]
                        self.refill(lane)
        return values

    def end(self):
        require(self.at == len(self.raw), "RANS-7", "words left over", self.place())
        require(all(x == LOW for x in self.states), "RANS-7", "states at the end",
                self.place())


class Table:
    def __init__(self, streams, integer, most):
        self.integer, self.slots = integer, []
        num_tokens = streams.vlq()
        require(1 <= num_tokens <= most, "RANS-2", f"{num_tokens} tokens")
        token = frequency = 0
        while token < num_tokens:
            frequency = streams.vlq()
            begin = len(self.slots)
            require(begin + frequency <= SLOTS, "RANS-2", "sum of frequencies")
            self.slots += [(token, begin, frequency)] * frequency
            token += 1 if frequency else 1 + streams.vlq()
        require(token == num_tokens and frequency > 0, "RANS-2", "last token")
        require(len(self.slots) == SLOTS, "RANS-2", "sum of frequencies")


def page_channels(header, index):
    """(name, contexts) of the channels of section 13.2 in a layer. SH comes last."""
    layer = header["layers"][index]
    channels = [("position", 1)]
    channels += [("mean_t", 1)] * (layer["mean_t"] not in (NONE, WINDOW))
    channels += [("mean_t_fine", 1)] * has_fine_mean_times(layer)
    if layer["mean_t"] == WINDOW:
        channels += [(name, 1) for name, bits in window_columns(layer) if bits]
    channels += [("opacity", 1)] * (header["opacity"]["coding"] == SQ)
    channels += [("scale_factor", 1)] * (layer["scale_factor"]["coding"] == SQ)
    for c in RansPage.order:
        name, coding = COMPONENTS[c], component(header, index, c)
        if coding["coding"] == VQ:
            channels += [(f"{name} depth", 1)] * has_depth(coding)
            channels += [(f"{name} index, stage {k}", 1) for k in range(len(coding["stages"]))]
            if coding["escapes"]:
                channels += [(f"{name} escape, number {j}", 1)
                           for j in range(vector_length(header, index, c))]
        elif coding["coding"] == TRANSFORM:
            channels += [(f"{name} step exponent", STEP_EXPONENTS)]
            channels += [(f"{name} EOB index", STEP_EXPONENTS)] * (len(coding["eob_table"]) > 1)
            channels += [(f"{name} coefficient {k}", STEP_EXPONENTS * MAGNITUDES if k else STEP_EXPONENTS)
                       for k in range(len(coding["steps"]))]
    return channels


def first_detail(header, channels):
    """How many of the channels the base chunk of a page holds, if there is an SH chunk."""
    names = [name for name, _ in channels]
    if header["sh_base"] == 0:
        return next((i for i, name in enumerate(names) if name.startswith("sh ")), len(names))
    name = f"sh coefficient {int(header['sh_base'])}"
    return names.index(name) if name in names else len(names)


def codable(header, index):
    """Whether RANS-6 lets a layer have rANS pages."""
    layer = header["layers"][index]
    return layer["mean_t"] != RAW64 and RAW32 not in (
        position_coding(header, index), layer["mean_t"],
        *[c["coding"] for c in (header["opacity"], header["sh"], layer["scale_factor"],
                                layer["scale"], layer["rotor_spatial"], layer["rotor_temporal"])])


def coefficient_context(step_exponent, before):
    """Of coefficient k of a Gaussian of step exponent step_exponent; before: its coefficients 0 to k-1."""
    if not before:
        return step_exponent
    a = sum(map(abs, before[-2:]))
    return MAGNITUDES * step_exponent + (0 if a == 0 else 1 if a < 3 else 2 if a < 7 else 3 if a < 15 else 4)


class Entropy:
    """An entropy chunk: the tables, and for each channel those of its contexts."""

    def __init__(self, file, chunk, header, channels):
        streams = Streams(file, chunk, "RANS-1")
        num_tables, num_wide = streams.vlq(), streams.vlq()
        with located(chunk.at):
            require(1 <= num_tables <= MAX_TABLES and 1 <= num_wide <= num_tables, "RANS-5",
                    f"{num_wide} of {num_tables} tables")
        streams.claim(0, f"entropy: {num_tables} tables, {num_wide} wide")
        tables = []
        for i in range(num_tables):
            begin, place = streams.at, streams.place()
            with located(place):
                tables.append(Table(streams, wide, 126) if i < num_wide else
                              Table(streams, hybrid, 112))
            streams.claim(begin, f"entropy: table {i}")
        self.channels = []
        for name, contexts in channels:
            begin, place = streams.at, streams.place()
            used = streams.take(contexts)
            least, most = (0, num_wide) if name == "position" else (num_wide, num_tables)
            require(all(least <= t < most for t in used), "RANS-4", f"tables of {name}", place)
            streams.claim(begin, f"entropy: map of {name}")
            self.channels.append((name, [tables[t] for t in used]))
        streams.end("CHNK-7")
        self.first_detail = first_detail(header, channels)


class RansPage:
    """The channels of a page, front to back: read() as Streams has it."""

    order = (SCALE, ROTOR_SPATIAL, ROTOR_TEMPORAL, SH)

    def __init__(self, file, first, detail, entropy, split):
        """first, detail: the Chunks of the parts; no detail where there is no SH chunk, or where
        it is left out. split: whether there is one."""
        self.blocks = [Block(file, first, "all channels" if not split else "base chunk")]
        if detail is not None:
            self.blocks.append(Block(file, detail, "SH chunk"))
        self.left = list(entropy.channels[:entropy.first_detail if split else None])
        self.left_in_detail = list(entropy.channels[entropy.first_detail:]) if detail else []
        self.symbols = 0

    def place(self):
        return self.blocks[not self.left and len(self.blocks) > 1].place()

    def read(self, n, width, what, limit=0, limit_clause="", contexts=None):
        of_detail = not self.left
        name, tables = (self.left_in_detail if of_detail else self.left).pop(0)
        assert name == what, f"{what} instead of {name}"
        block = self.blocks[of_detail]
        place = block.place()
        values = block.channel([tables[c] for c in contexts or [0] * n])
        self.symbols += len(values)
        bound, clause = (limit, limit_clause) if limit else (1 << width, "STRM-3")
        require(all(v < bound for v in values), clause, f"{what}, limit {bound}", place)
        return values

    def positions(self, n, width):
        """x, y and z of ascending Morton codes, of which the channel holds the gaps."""
        place = self.place()
        gaps, code, out = self.read(n, 64, "position"), 0, ([], [], [])
        for gap in gaps:
            code += gap
            require(code < 1 << 3 * width, "RANS-8", f"Morton code {code:x}", place)
            for j in range(3):
                out[j].append(sum((code >> 3 * b + j & 1) << b for b in range(width)))
        return out

    def end(self):
        for block in self.blocks:
            block.end()
        assert not self.left and not self.left_in_detail

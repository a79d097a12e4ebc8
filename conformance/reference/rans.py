# SPDX-License-Identifier: Apache-2.0
"""rANS blocks, entropy chunks and rANS pages: sections 9.1, 10.2 and 13.2 of spec/l4d.md."""

import struct

from header import FIXED, NONE, RAW32, RAW64, SQ, TRANSFORM, VQ
from streams import Columns, Streams, require

LANES = 32
SLOTS = 4096
LOW = 1 << 16
MAX_TABLES = 128
CLASSES = 16
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
    """The planes of one rANS block, front to back."""

    def __init__(self, raw, base, file, what):
        require(len(raw) >= 4 * LANES, "RANS-1", f"a block of {len(raw)} bytes")
        file.claim(base, base + 4 * LANES, f"{what}: states of 32 lanes")
        if len(raw) > 4 * LANES:
            file.claim(base + 4 * LANES, base + len(raw), f"{what}: words")
        self.raw, self.at = raw, 4 * LANES
        self.states = list(struct.unpack_from(f"<{LANES}I", raw))
        require(min(self.states) >= LOW, "RANS-3", f"state {min(self.states)}")

    def refill(self, lane):
        if self.states[lane] < LOW:
            require(self.at + 2 <= len(self.raw), "RANS-7", "words are missing")
            word = int.from_bytes(self.raw[self.at:self.at + 2], "little")
            self.states[lane] = (self.states[lane] << 16) + word
            self.at += 2

    def plane(self, tables):
        """One integer for each of the tables."""
        values = []
        for group in range(0, len(tables), LANES):
            pieces = []
            for lane, table in enumerate(tables[group:group + LANES]):
                x = self.states[lane]
                token, begin, frequency = table.slots[x % SLOTS]
                self.states[lane] = frequency * (x >> 12) + x % SLOTS - begin
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
        require(self.at == len(self.raw), "RANS-7", "words left over")
        require(all(x == LOW for x in self.states), "RANS-7", "states at the end")


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


def has_fine_mean_times(layer):
    return bool(layer["mean_t"] == FIXED and layer["mean_t_fine"])


def page_planes(header, layer):
    """(name, contexts) of the planes of section 13.2. SH comes last."""
    planes = [("position", 1)]
    planes += [("mean_t", 1)] * (layer["mean_t"] != NONE)
    planes += [("mean_t_fine", 1)] * has_fine_mean_times(layer)
    planes += [("opacity", 1)] * (header["opacity"]["coding"] == SQ)
    planes += [("scale_factor", 1)] * (layer["scale_factor"]["coding"] == SQ)
    for name in ("scale", "rotor_spatial", "rotor_temporal", "sh"):
        coding = header["sh"] if name == "sh" else layer[name]
        if coding["coding"] == VQ:
            stages = len(coding["stages"])
            planes += [(f"{name} depth", 1)] * (stages > 1 or bool(coding["literals"]))
            planes += [(f"{name} index, stage {k}", 1) for k in range(stages)]
            if coding["literals"]:
                planes += [(f"{name} literal, number {j}", 1)
                           for j in range(vector_length(header, layer, name))]
        elif coding["coding"] == TRANSFORM:
            planes += [(f"{name} class", CLASSES)]
            planes += [(f"{name} rung", CLASSES)] * (len(coding["ladder"]) > 1)
            planes += [(f"{name} coefficient {k}", CLASSES * MAGNITUDES if k else CLASSES)
                       for k in range(len(coding["steps"]))]
    return planes


def first_detail(header, planes):
    """How many of the planes the first part of a page holds, if it has a second."""
    names = [name for name, _ in planes]
    if header["sh_base"] == 0:
        return next((i for i, name in enumerate(names) if name.startswith("sh ")), len(names))
    name = f"sh coefficient {int(header['sh_base'])}"
    return names.index(name) if name in names else len(names)


def vector_length(header, layer, name):
    if name == "sh":
        return 3 * (int(header["sh_degree"]) + 1) ** 2
    if name == "scale":
        return 3 if layer["permanent"] else 4
    return 3 if layer[name]["coding"] == TRANSFORM else 4


def codable(header, layer):
    """Whether RANS-6 lets a layer have rANS pages."""
    return layer["mean_t"] != RAW64 and RAW32 not in (
        RAW32 if layer["raw_position"] else header["position"], layer["mean_t"],
        *[c["coding"] for c in (header["opacity"], header["sh"], layer["scale_factor"],
                                layer["scale"], layer["rotor_spatial"], layer["rotor_temporal"])])


class Entropy:
    """An entropy chunk: the tables, and for each plane those of its contexts."""

    def __init__(self, file, raw, base, header, layer):
        streams = Streams(file, raw, base, "RANS-1")
        num_tables, num_wide = streams.vlq(), streams.vlq()
        require(1 <= num_tables <= MAX_TABLES and 1 <= num_wide <= num_tables, "RANS-5",
                f"{num_wide} of {num_tables} tables")
        file.claim(base, base + streams.at, f"entropy: {num_tables} tables, {num_wide} wide")
        tables = []
        for i in range(num_tables):
            begin = streams.at
            tables.append(Table(streams, wide, 126) if i < num_wide else
                          Table(streams, hybrid, 112))
            file.claim(base + begin, base + streams.at, f"entropy: table {i}")
        self.planes = []
        for name, contexts in page_planes(header, layer):
            begin = streams.at
            used = streams.take(contexts)
            least, most = (0, num_wide) if name == "position" else (num_wide, num_tables)
            require(all(least <= t < most for t in used), "RANS-4", f"tables of {name}")
            file.claim(base + begin, base + streams.at, f"entropy: map of {name}")
            self.planes.append((name, [tables[t] for t in used]))
        streams.end("CHNK-7")
        self.first_detail = first_detail(header, page_planes(header, layer))


class RansPage(Columns):
    """The planes of a page, front to back."""

    order = (1, 2, 3, 0)                  # of components
    class_clause = "TRAN-5"

    def __init__(self, file, first, detail, entropy, split):
        """first, detail: (raw, base) of the parts; no detail where there is no second part, or where
        it is left out. split: whether there is one."""
        self.blocks = [Block(*first, file, "all planes" if not split else "first part")]
        if detail is not None:
            self.blocks.append(Block(*detail, file, "second part"))
        self.left = list(entropy.planes[:entropy.first_detail if split else None])
        self.left_in_detail = list(entropy.planes[entropy.first_detail:]) if detail else []

    def read(self, n, width, what, limit=0, limit_clause="", contexts=None):
        of_detail = not self.left
        name, tables = (self.left_in_detail if of_detail else self.left).pop(0)
        assert name == what, f"{what} instead of {name}"
        block = self.blocks[of_detail]
        values = block.plane([tables[c] for c in contexts or [0] * n])
        bound, clause = (limit, limit_clause) if limit else (1 << width, "STRM-3")
        require(all(v < bound for v in values), clause, f"{what}, limit {bound}")
        return values

    def positions(self, n, fixed, bits):
        width = bits if fixed else 16
        gaps, code, out = self.read(n, 64, "position"), 0, ([], [], [])
        for gap in gaps:
            code += gap
            require(code < 1 << 3 * width, "RANS-8", f"Morton code {code:x}")
            for j in range(3):
                out[j].append(sum((code >> 3 * b + j & 1) << b for b in range(width)))
        return out

    def end(self):
        for block in self.blocks:
            block.end()
        assert not self.left and not self.left_in_detail

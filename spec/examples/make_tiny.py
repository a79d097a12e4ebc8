#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes tiny.l4d, the worked example of spec/l4d.md: three Gaussians, one layer, no compression.

It lays the bytes out by hand, so that the example depends on no encoder: make_tiny.py [FILE]
"""

import struct
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1] / "conformance" / "reference"))

from xxh3 import xxh3_64    # noqa: E402



# ---- FlatBuffers, written front to back ----------------------------------------------------------

class Table:
    """fields: (slot, form, value) in any order. Values of form "offset", which are a Table, a list
    of Tables or of Structs, Scalars, or bytes of a string, go behind the table."""

    def __init__(self, *fields):
        self.fields = list(fields)


class Struct(bytes):
    """Packed bytes that lie inside their table or vector. All structs of the schema but Vec3 are
    aligned to 8."""


class Scalars(list):
    """A vector of numbers of at most 4 bytes each, all of one form."""

    def __init__(self, form, values):
        super().__init__(values)
        self.form = form


def chunk_ref(offset, raw):
    return Struct(struct.pack("<QQIIII", offset, xxh3_64(raw), len(raw), len(raw), 0, 0))


def write_flatbuffer(root, identifier):
    out = bytearray(struct.pack("<I4s", 0, identifier))

    def align(to, ahead=0):
        while (len(out) + ahead) % to:
            out.append(0)

    def patch(at, target):
        struct.pack_into("<I", out, at, target - at)

    def write_table(table):
        inline = []                       # (alignment, slot, bytes or child)
        for slot, form, value in table.fields:
            if form == "struct":
                inline.append((8 if len(value) != 12 else 4, slot, bytes(value), None))
            elif form == "offset":
                inline.append((4, slot, bytes(4), value))
            else:
                packed = struct.pack("<" + form, value)
                inline.append((len(packed), slot, packed, None))
        inline.sort(key=lambda f: (-f[0], f[1]))
        slots = max((f[1] for f in inline), default=-1) + 1
        size = 4 + sum(len(f[2]) for f in inline)
        vtable = [4 + 2 * slots, size] + [0] * slots
        at = 4
        for _, slot, packed, _ in inline:
            vtable[2 + slot] = at
            at += len(packed)
        align(2)
        # The first field follows the four bytes of the vtable's offset and is the most aligned.
        align(8, ahead=2 * len(vtable) + 4)
        out.extend(struct.pack(f"<{len(vtable)}H", *vtable))
        begin = len(out)
        out.extend(struct.pack("<i", 2 * len(vtable)))
        for f in inline:
            out.extend(f[2])
        for _, slot, _, child in inline:
            if child is not None:
                patch(begin + vtable[2 + slot], write_child(child))
        return begin

    def write_child(child):
        if isinstance(child, Table):
            return write_table(child)
        if isinstance(child, bytes):
            align(4)
            out.extend(struct.pack("<I", len(child)) + child + b"\0")
            return len(out) - len(child) - 5
        if isinstance(child, Scalars):
            align(4)
            out.extend(struct.pack(f"<I{len(child)}{child.form}", len(child), *child))
            return len(out) - struct.calcsize(f"<I{len(child)}{child.form}")
        structs = bool(child) and isinstance(child[0], Struct)
        align(8 if structs else 4, ahead=4 if structs else 0)
        begin = len(out)
        out.extend(struct.pack("<I", len(child)))
        if structs:
            out.extend(b"".join(child))
            return begin
        slots = len(out)
        out.extend(bytes(4 * len(child)))
        for i, table in enumerate(child):
            patch(slots + 4 * i, write_table(table))
        return begin

    target = write_table(root)
    struct.pack_into("<I", out, 0, target)
    return bytes(out)


# ---- streams -------------------------------------------------------------------------------------

def order(value):
    bits = struct.unpack("<H", struct.pack("<e", value))[0]
    return bits ^ (0xFFFF if bits & 0x8000 else 0x8000)


def packed(values, width):
    bits = sum(v << i * width for i, v in enumerate(values))
    return b"\x00" + bits.to_bytes((len(values) * width + 7) // 8, "little")


def constant(value, width):
    return b"\x02" + value.to_bytes((width + 7) // 8, "little")


def planes(values, width):
    return b"\x01" + b"".join(b"\x00" + bytes(v >> 8 * p & 0xFF for v in values)
                              for p in range((width + 7) // 8))


def packed_delta(values):
    return b"\x04" + packed(zigzag_deltas(values, 16), 16)[1:]


def zigzag_deltas(values, width):
    top = 1 << (width - 1)
    deltas = [(v - p + top) % (2 * top) - top for v, p in zip(values, [0, *values])]
    return [2 * d if d >= 0 else -2 * d - 1 for d in deltas]


def codebook(rows):
    out = b""
    for column in zip(*rows):
        codes = [order(v) for v in column]
        out += constant(codes[0], 16) if len(set(codes)) == 1 else packed(codes, 16)
    return out


# ---- the scene -----------------------------------------------------------------------------------

SH_CODEBOOK = [(0.5, -0.25, 1.0), (0.0, 0.75, -0.5)]
SCALE_CODEBOOK = [(0.5, 0.0, -0.5, 3.0), (-0.25, 0.25, 0.0, 3.5), (1.0, -1.0, 0.0, 2.0)]
SPATIAL_CODEBOOK = [(1.0, 0.0, 0.0, 0.0), (0.75, 0.5, -0.25, 0.125)]
TEMPORAL_CODEBOOK = [(0.0625, 0.0, -0.03125, 0.015625)]

PAGE = b"".join((
    packed([order(v) for v in (4.0, -2.0, 0.0)], 16),            # x
    constant(order(1.5), 16),                                    # y
    packed_delta([order(v) for v in (1.0, 1.5, 2.0)]),           # z
    planes([order(v) for v in (0.0, 0.25, -0.5)], 16),           # mean_t
    packed([255, 128, 51], 8),                                   # opacity
    packed([1, 15, 1], 4),                                       # sh: depths
    packed([0, 1], 1),                                           # sh: indices of Gaussians 0 and 2
    b"".join(constant(order(v), 16) for v in (0.125, 2.0, -1.0)),  # sh: the escape of Gaussian 1
    packed([2, 0, 1], 2),                                        # scale
    packed([0, 1, 1], 1),                                        # rotor_spatial
))                                                               # rotor_temporal: one entry, 0 bits


def vq(num_entries, codebook, escapes=False):
    stage = Table((0, "I", num_entries), (2, "struct", codebook))
    return Table((0, "B", 2), (1, "offset", [stage]), *[(2, "B", 1)] * escapes)


def scene_header(codebooks, page_table_offset, payload_offset):
    sh, scale, spatial, temporal = codebooks
    layer = Table((2, "Q", 3), (3, "B", 2),
                  (5, "offset", Table((2, "f", -3.0))),          # scale_factor: constant
                  (6, "offset", vq(3, scale)), (7, "offset", vq(2, spatial)),
                  (8, "offset", vq(1, temporal)), (10, "Q", page_table_offset))
    return write_flatbuffer(Table(
        (0, "Q", 3), (1, "d", 1.0), (2, "I", 2), (3, "I", 4), (4, "I", 1),
        (6, "struct", Struct(struct.pack("<3d", 100.0, 0.0, -20.0))), (8, "B", 1), (12, "B", 2),
        (13, "struct", Struct(struct.pack("<3f", 1.0, 0.5, -3.0))), (14, "f", 0.25),
        (15, "offset", Table((0, "B", 2), (1, "B", 8), (3, "f", 1 / 255))),
        (17, "offset", vq(2, sh, escapes=True)), (18, "offset", [layer]),
        (19, "Q", payload_offset)), b"L4DH")


def directory_page():
    box = struct.unpack("<6H", struct.pack("<6e", -16.0, -16.0, -16.0, 16.0, 16.0, 16.0))
    record = Struct(struct.pack("<4Q6I4B6H", 0, xxh3_64(PAGE), 0, 0, len(PAGE), len(PAGE), 0, 3, 0,
                                0xFFFFFFFF, 0, 96, 160, 0, *box))
    return write_flatbuffer(Table((2, "offset", [record])), b"L4DD")


def make():
    raw_codebooks = [codebook(b) for b in (SH_CODEBOOK, SCALE_CODEBOOK, SPATIAL_CODEBOOK, TEMPORAL_CODEBOOK)]
    header = scene_header([chunk_ref(0, b) for b in raw_codebooks], 1, 1)   # for its size alone
    at = 40 + len(header)
    codebooks = []
    for raw in raw_codebooks:
        codebooks.append(chunk_ref(at, raw))
        at += len(raw)
    directory = directory_page()
    entry = struct.pack("<QQIII", at + 32, xxh3_64(directory), len(directory), len(directory), 0)
    entry += struct.pack("<I", xxh3_64(entry) & 0xFFFFFFFF)
    header = scene_header(codebooks, at, at + 32 + len(directory))
    head = struct.pack("<8sBBHIQQ", bytes.fromhex("894c34440d0a1a0a"), 1, 0, 1, len(header), 40,
                       xxh3_64(header))
    head += struct.pack("<Q", xxh3_64(head))
    return b"".join([head, header, *raw_codebooks, entry, directory, PAGE])


if __name__ == "__main__":
    Path(sys.argv[1] if len(sys.argv) > 1 else HERE / "tiny.l4d").write_bytes(make())

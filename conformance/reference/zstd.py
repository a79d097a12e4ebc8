# SPDX-License-Identifier: Apache-2.0
"""A Zstandard frame, RFC 8878, as section 7 of spec/l4d.md allows it: no dictionary, no skippable
frame. Whatever is wrong breaks CHNK-5."""

from arithmetic import require
from fse import RULE, BackwardBits, Fse, Huffman, read_counts
from xxh64 import xxh64

MAGIC = 0xFD2FB528
MOST_WINDOW = 1 << 26
MOST_BLOCK = 1 << 17


def bases(first, widths):
    """(base, extra bits) of codes that follow each other."""
    out = []
    for width in widths:
        out.append((first, width))
        first += 1 << width
    return out


LITERAL_LENGTHS = bases(0, [0] * 16 + [1] * 4 + [2, 2, 3, 3, 4, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16])
MATCH_LENGTHS = bases(3, [0] * 32 + [1] * 4 + [2, 2, 3, 3, 4, 4, 5, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16])
OFFSETS = [(1 << code, code) for code in range(32)]
# What each kind of number is decoded from: its codes, the most accurate table, the predefined one.
LITERAL, OFFSET, MATCH = (
    (LITERAL_LENGTHS, 9, (6, [4, 3] + [2] * 11 + [1, 1, 1] + [2] * 9 + [3, 2] + [1] * 5 + [-1] * 4)),
    (OFFSETS, 8, (5, [1] * 6 + [2] * 3 + [1] * 15 + [-1] * 5)),
    (MATCH_LENGTHS, 9, (6, [1, 4, 3] + [2] * 6 + [1] * 37 + [-1] * 7)))


class Reader:
    """Bytes front to back."""

    def __init__(self, data):
        self.data, self.at = data, 0

    def take(self, n):
        require(self.at + n <= len(self.data), RULE, "zstd: the frame ends too early")
        self.at += n
        return self.data[self.at - n:self.at]

    def number(self, n):
        return int.from_bytes(self.take(n), "little")

    def rest(self):
        return self.take(len(self.data) - self.at)


def frame_header(r):
    """(window size, content size or None, whether there is a checksum)"""
    require(r.number(4) == MAGIC, RULE, "zstd: magic number")
    descriptor = r.number(1)
    single, size_code = descriptor >> 5 & 1, descriptor >> 6
    require(descriptor & 8 == 0, RULE, "zstd: reserved bit")
    window = 0
    if not single:
        b = r.number(1)
        window = (1 << 10 + (b >> 3)) // 8 * (8 + (b & 7))
    require(r.number((0, 1, 2, 4)[descriptor & 3]) == 0, RULE, "zstd: a dictionary")
    width = (single, 2, 4, 8)[size_code]
    size = r.number(width) + 256 * (width == 2) if width else None
    window = size if single else window
    require(window <= MOST_WINDOW, RULE, "zstd: Window_Size")
    return window, size, bool(descriptor & 4)


def decompress(data, most):
    """What a frame holds, at most `most` bytes. The frame fills the data exactly."""
    r, out, tables = Reader(data), bytearray(), Tables()
    window, size, has_checksum = frame_header(r)
    most_block = min(window, MOST_BLOCK)
    last = False
    while not last:
        head = r.number(3)
        last, kind, n = head & 1, head >> 1 & 3, head >> 3
        require(kind < 3 and n <= most_block, RULE, "zstd: a block")
        before = len(out)
        if kind == 0:
            out += r.take(n)
        elif kind == 1:
            out += r.take(1) * n
        else:
            compressed_block(r.take(n), out, tables)
        require(len(out) - before <= most_block and len(out) <= most, RULE, "zstd: size of a block")
    require(size is None or len(out) == size, RULE, "zstd: content size")
    require(not has_checksum or r.number(4) == xxh64(out) & 0xFFFFFFFF, RULE, "zstd: checksum")
    require(r.at == len(data), RULE, "zstd: bytes after the frame")
    return bytes(out)


class Tables:
    """What blocks take over from the blocks before."""

    def __init__(self):
        self.huffman = None
        self.fse = [None] * 3
        self.offsets = [1, 4, 8]


def literals(r, tables):
    first = r.number(1)
    kind, form = first & 3, first >> 2 & 3
    r.at -= 1
    if kind < 2:
        n = r.number(1) >> 3 if form % 2 == 0 else r.number(2 + form // 2) >> 4
        require(n <= MOST_BLOCK, RULE, "zstd: literals")
        return r.take(n) if kind == 0 else r.take(1) * n
    width = (10, 10, 14, 18)[form]
    sizes = r.number((4 + 2 * width + 7) // 8) >> 4
    n, stored = sizes & (1 << width) - 1, sizes >> width
    require(n <= MOST_BLOCK, RULE, "zstd: literals")
    body = Reader(r.take(stored))
    if kind == 2:
        tables.huffman, used = Huffman.read(body.data)
        body.take(used)
    require(tables.huffman is not None, RULE, "zstd: no Huffman table before")
    if form == 0:
        return tables.huffman.decode(body.rest(), n)
    streams = [body.number(2) for _ in range(3)]
    each = (n + 3) // 4
    require(3 * each <= n, RULE, "zstd: literals of four streams")
    parts = [tables.huffman.decode(body.take(size), each) for size in streams]
    return b"".join(parts) + tables.huffman.decode(body.rest(), n - 3 * each)


def read_table(r, mode, kind, before):
    """The FSE table of one kind of number."""
    codes, most_log, (log, counts) = kind
    if mode == 0:
        return Fse(log, counts)
    if mode == 1:
        symbol = r.number(1)
        require(symbol < len(codes), RULE, "zstd: code of a sequence")
        return Fse.of_one(symbol)
    if mode == 2:
        log, counts, used = read_counts(r.data[r.at:], most_log, len(codes))
        r.take(used)
        return Fse(log, counts)
    require(before is not None, RULE, "zstd: no table before")
    return before


def compressed_block(data, out, tables):
    r = Reader(data)
    text = Reader(literals(r, tables))
    count = r.number(1)
    if count > 127:
        count = (count - 128 << 8) + r.number(1) if count < 255 else r.number(2) + 0x7F00
    if count > 0:
        modes = r.number(1)
        require(modes & 3 == 0, RULE, "zstd: modes of sequences")
        kinds = (LITERAL, OFFSET, MATCH)
        tables.fse = [read_table(r, modes >> 6 - 2 * k & 3, kinds[k], tables.fse[k]) for k in range(3)]
        sequences(BackwardBits(r.rest()), count, text, out, tables)
    require(r.at == len(data), RULE, "zstd: bytes after the sequences")
    out += text.rest()


def sequences(bits, count, text, out, tables):
    """Copies of literals and of what is in `out`, as each sequence says."""
    states = [bits.read(table.log) for table in tables.fse]
    for i in range(count):
        rows = [table.states[x] for table, x in zip(tables.fse, states)]
        offset, match, literal = (codes[row[0]][0] + bits.read(codes[row[0]][1])
                                  for codes, row in ((OFFSETS, rows[1]), (MATCH_LENGTHS, rows[2]),
                                                     (LITERAL_LENGTHS, rows[0])))
        if i + 1 < count:
            for k in (0, 2, 1):
                states[k] = rows[k][2] + bits.read(rows[k][1])
        require(bits.left >= 0, RULE, "zstd: sequences end too early")
        out += text.take(literal)
        distance = distance_of(offset, literal, tables.offsets)
        require(0 < distance <= len(out), RULE, "zstd: offset of a match")
        require(match <= MOST_BLOCK, RULE, "zstd: size of a block")
        begin = len(out) - distance
        while match > 0:                              # what is copied may be what was just written
            piece = out[begin:begin + match]
            out += piece
            match -= len(piece)
            begin += len(piece)
        require(len(out) <= MOST_WINDOW + MOST_BLOCK, RULE, "zstd: size of a block")
    require(bits.left == 0, RULE, "zstd: bits after the sequences")


def distance_of(offset, literal, recent):
    """The distance that an offset stands for; the three most recent ones have short names."""
    if offset > 3:
        recent[:] = [offset - 3, *recent[:2]]
        return recent[0]
    which = offset - 1 + (literal == 0)
    distance = recent[which] if which < 3 else recent[0] - 1
    if which > 0:
        recent[:] = [distance, recent[0], recent[2] if which == 1 else recent[1]]
    return distance

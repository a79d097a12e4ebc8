# SPDX-License-Identifier: Apache-2.0
"""Streams, section 9 of spec/l4d.md: what chunks are made of."""

import zstd
from arithmetic import Invalid, located, require, unzigzag


class Streams:
    """The streams of one chunk, front to back. clause: what is broken where they end too early."""

    symbols = 0     # of rANS

    def __init__(self, file, chunk, clause="STRM-2"):
        self.file, self.chunk, self.at, self.clause = file, chunk, 0, clause

    def place(self):
        return self.chunk.place(self.at)

    def claim(self, begin, text):
        """Tells what the raw bytes from `begin` to here mean."""
        if self.chunk.is_stored:
            self.file.claim(self.chunk.at + begin, self.chunk.at + self.at, text)

    def take(self, n):
        require(self.at + n <= len(self.chunk.raw), self.clause, "a chunk ends too early",
                self.place())
        self.at += n
        return self.chunk.raw[self.at - n:self.at]

    def vlq(self):
        value, place = 0, self.place()
        for shift in range(0, 63, 7):
            b = self.take(1)[0]
            value |= (b & 0x7F) << shift
            if b < 0x80:
                return value
        raise Invalid(self.clause, "vlq of more than 9 bytes", place)

    def plane(self, n):
        place = self.place()
        codec = self.take(1)[0]
        require(codec <= 1, "CHNK-6", f"codec {codec} of a plane", place)
        if codec == 0:
            return self.take(n)
        place, frame = self.place(), self.take(self.vlq())
        with located(place):
            out = zstd.decompress(frame, n)
            require(len(out) == n, "CHNK-5", "size of what a frame holds")
        return out

    def read(self, n, width, what, limit=0, limit_clause="", contexts=None):
        """n values of `width` bits, all below `limit` where that is not 0."""
        del contexts                      # they concern rANS pages
        if n == 0 or width == 0:
            return [0] * n
        begin, place = self.at, self.place()
        mode = self.take(1)[0]
        layout, delta = mode & 3, bool(mode & 4)
        with located(place):
            require(mode < 8 and layout < 3, "STRM-1", f"mode {mode}")
            require(not delta or width in (16, 32) and layout != 2, "STRM-6", f"delta, {width} bits")
        if layout == 0:
            values = self.packed(n, width)
        elif layout == 1:
            planes = [self.plane(n) for _ in range((width + 7) // 8)]
            values = [sum(b << 8 * k for k, b in enumerate(bytes_of)) for bytes_of in zip(*planes)]
        else:
            values = [int.from_bytes(self.take((width + 7) // 8), "little")] * n
        if delta:
            values = undo_delta(values, width)
        bound, clause = (limit, limit_clause) if limit else (1 << width, "STRM-3")
        require(max(values) < bound, clause, f"{what}: value {max(values)}, limit {bound}", place)
        if self.file.explain and self.chunk.is_stored:
            self.explain(begin, what, mode, values, width)
        return values

    def packed(self, n, width):
        data = self.take((n * width + 7) // 8)
        require(n * width % 8 == 0 or data[-1] >> n * width % 8 == 0, "STRM-4", "padding",
                self.chunk.place(self.at - 1))
        values = []
        for i in range(n):                # 5 bytes hold any value of up to 32 bits
            first = i * width >> 3
            word = int.from_bytes(data[first:first + 5], "little")
            values.append(word >> i * width % 8 & (1 << width) - 1)
        return values

    def explain(self, begin, what, mode, values, width):
        form = ("packed", "planes", "constant")[mode & 3] + ", delta" * (mode >> 2)
        at = self.chunk.at
        self.file.claim(at + begin, at + begin + 1,
                        f"{what}: mode {mode} = {form}; {len(values)} x {width} bits")
        shown = " ".join(f"{v:0{(width + 3) // 4}x}" for v in values)
        self.file.claim(at + begin + 1, at + self.at, f"  values {shown}")

    def end(self, clause="PAGE-1"):
        require(self.at == len(self.chunk.raw), clause, "bytes left over", self.place())


def undo_delta(coded, width):
    """STRM-5: sums are modulo 2^width, whatever the deltas."""
    values, previous = [], 0
    for z in coded:
        previous = (previous + unzigzag(z)) % (1 << width)
        values.append(previous)
    return values

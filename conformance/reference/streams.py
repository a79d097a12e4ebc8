# SPDX-License-Identifier: Apache-2.0
"""The arithmetic of spec/l4d.md and its streams, section 9."""

import struct

from flatbuffer import Invalid


def require(ok, clause, message):
    if not ok:
        raise Invalid(clause, message)


# ---- arithmetic ----------------------------------------------------------------------------------

def f32(x):
    """binary64 to the nearest binary32. Applied to one +, -, *, / or sqrt of binary32 operands it
    gives the correctly rounded binary32 result: binary64 has more than twice the precision."""
    return struct.unpack("<f", struct.pack("<f", x))[0]


def f32_of_bits(bits):
    return struct.unpack("<f", struct.pack("<I", bits))[0]


def bits_of_f32(x):
    return struct.unpack("<I", struct.pack("<f", x))[0]


def half(bits):
    return struct.unpack("<e", struct.pack("<H", bits))[0]


def unorder(value, width):
    top = 1 << (width - 1)
    return value ^ top if value & top else value ^ (2 * top - 1)


def bit_width(limit):
    return (limit - 1).bit_length()


def sound(v):
    return v == 0 or 2.0 ** -60 <= abs(v) <= 2.0 ** 60


# ---- streams -------------------------------------------------------------------------------------

class Columns:
    """Floats from the integers of read(), in either form of a page."""

    def halves(self, n, what, clause):
        return finite_halves(self.read(n, 16, what), what, clause)


    def multiples(self, step):
        """A reader like `halves`, of signed integers times a step."""
        def read(n, what, _):
            return [f32(step * f32((v >> 1) ^ -(v & 1))) for v in self.read(n, 16, what)]
        return read


def part_of_step(fine):
    """Where in the step of a fixed mean time the middle of the cell lies that `fine` names."""
    k = (fine + 1).bit_length() - 1
    return (2 * (fine + 1 - 2 ** k) + 1 - 2 ** k) / 2 ** (k + 1)


def finite_halves(ordered, what, clause):
    bits = [unorder(v, 16) for v in ordered]
    require(all(b & 0x7FFF < 0x7C00 for b in bits), clause, f"{what} is not finite")
    return [half(b) for b in bits]


class Streams(Columns):
    """The streams of one chunk, front to back."""

    order = (0, 1, 2, 3)                  # of components
    class_clause = "STRM-3"

    def __init__(self, file, raw, base, clause="STRM-2"):
        self.file, self.raw, self.base, self.at, self.clause = file, raw, base, 0, clause

    def take(self, n):
        require(self.at + n <= len(self.raw), self.clause, f"byte {self.base + self.at}")
        self.at += n
        return self.raw[self.at - n:self.at]

    def vlq(self):
        value = 0
        for shift in range(0, 63, 7):
            b = self.take(1)[0]
            value |= (b & 0x7F) << shift
            if b < 0x80:
                return value
        raise Invalid(self.clause, "vlq of more than 9 bytes")

    def planes(self, n, count):
        planes = []
        for _ in range(count):
            codec = self.take(1)[0]
            require(codec <= 1, "CHNK-6", f"codec {codec} of a plane")
            if codec == 1:
                self.take(self.vlq())
                raise NotImplementedError("zstd")
            planes.append(self.take(n))
        return [sum(p[i] << 8 * k for k, p in enumerate(planes)) for i in range(n)]

    def read(self, n, width, what, limit=0, limit_clause="", contexts=None):
        """n values of `width` bits, all below `limit` where that is not 0."""
        del contexts                      # they concern rANS
        if n == 0 or width == 0:
            return [0] * n
        begin = self.at
        mode = self.take(1)[0]
        layout, delta = mode & 3, bool(mode & 4)
        require(mode < 8 and layout < 3, "STRM-1", f"mode {mode}")
        require(not delta or width in (16, 32) and layout != 2, "STRM-6", f"delta, {width} bits")
        if layout == 0:
            bits = int.from_bytes(self.take((n * width + 7) // 8), "little")
            require(bits >> n * width == 0, "STRM-4", "padding")
            values = [bits >> i * width & (1 << width) - 1 for i in range(n)]
        elif layout == 1:
            values = self.planes(n, (width + 7) // 8)
        else:
            values = [int.from_bytes(self.take((width + 7) // 8), "little")] * n
        if delta:
            coded, values, previous = values, [], 0
            for z in coded:
                previous = (previous + ((z >> 1) ^ -(z & 1))) % (1 << width)
                values.append(previous)
        bound, clause = (limit, limit_clause) if limit else (1 << width, "STRM-3")
        require(max(values) < bound, clause, f"value {max(values)}, limit {bound}")
        form = ("packed", "planes", "constant")[layout] + ", delta" * delta
        self.file.claim(self.base + begin, self.base + begin + 1,
                        f"{what}: mode {mode} = {form}; {n} x {width} bits")
        shown = " ".join(f"{v:0{(width + 3) // 4}x}" for v in values)
        self.file.claim(self.base + begin + 1, self.base + self.at, f"  values {shown}")
        return values

    def positions(self, n, fixed, bits):
        limit = 1 << bits if fixed else 0
        return [self.read(n, 32 if fixed else 16, f"position {axis}", limit, "STRM-3")
                for axis in "xyz"]

    def floats(self, n, what):
        bits = [unorder(v, 32) for v in self.read(n, 32, what)]
        require(all(b & 0x7FFFFFFF < 0x7F800000 for b in bits), "VAL-3", f"{what} is not finite")
        return [f32_of_bits(b) for b in bits]

    def doubles(self, n, what):
        high, low = self.read(n, 32, f"{what} high"), self.read(n, 32, f"{what} low")
        ordered = [h << 32 | lo for h, lo in zip(high, low)]
        values = [struct.unpack("<d", unorder(v, 64).to_bytes(8, "little"))[0] for v in ordered]
        require(all(abs(v) <= 2.0 ** 60 for v in values), "VAL-3", f"{what} is out of range")
        return values

    def end(self, clause="PAGE-1"):
        require(self.at == len(self.raw), clause, "bytes left over")

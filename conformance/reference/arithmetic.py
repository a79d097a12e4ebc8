# SPDX-License-Identifier: Apache-2.0
"""Section 2 of spec/l4d.md: numbers, and how a broken rule is told."""

import contextlib
import struct


class Invalid(Exception):
    """A broken rule: its clause, and the byte of the file where it shows, if that is known."""

    def __init__(self, clause, message, offset=None):
        super().__init__(f"{clause}: {message}")
        self.clause, self.message, self.offset = clause, message, offset

    def __reduce__(self):
        """As it crosses from one process to another."""
        return Invalid, (self.clause, self.message, self.offset)


def require(ok, clause, message, offset=None):
    if not ok:
        raise Invalid(clause, message, offset)


@contextlib.contextmanager
def located(offset):
    """Broken rules that are found inside and tell no place get this one."""
    try:
        yield
    except Invalid as broken:
        if broken.offset is None:
            broken.offset = offset
        raise


def f32(x):
    """binary64 to the nearest binary32. Applied to one +, -, *, / or sqrt of binary32 operands it
    gives the correctly rounded binary32 result: binary64 has more than twice the precision."""
    return struct.unpack("<f", struct.pack("<f", x))[0]


def f32_of_bits(bits):
    return struct.unpack("<f", struct.pack("<I", bits))[0]


def bits_of_f32(x):
    return struct.unpack("<I", struct.pack("<f", x))[0]


def half(bits):
    """The number of the bits of a binary16."""
    return struct.unpack("<e", struct.pack("<H", bits))[0]


def unorder(value, width):
    """The bits of an ordered float (section 9)."""
    top = 1 << (width - 1)
    return value ^ top if value & top else value ^ (2 * top - 1)


def unzigzag(z):
    return (z >> 1) ^ -(z & 1)


def bit_width(limit):
    """W of section 11: bits that tell `limit` things apart."""
    return (limit - 1).bit_length()


def limit(v, low, high):
    """Section 14: v, or the end of the interval that it is beyond."""
    return low if v < low else high if v > high else v


def sound(v):
    """HEAD-3: 0, or a magnitude in 2^-60..2^60."""
    return v == 0 or 2.0 ** -60 <= abs(v) <= 2.0 ** 60

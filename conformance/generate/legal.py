# SPDX-License-Identifier: Apache-2.0
"""What a random Gaussian may be so that its layer keeps LAYR-1, and its page DIR-9 and DIR-10: sections 12
and 15 of spec/l4d.md.

In a layer of level 1 or finer, the decoded log scales stay below log(width / 16). A rotation leaves vectors
their length, so sigma is at most width / 16, and a Gaussian is visible for a quarter of a width before and
after its mean time. A mean time within 0.7 widths of the bucket's centre then keeps LAYR-1; so does one so far
outside the sequence that nothing is visible. Flat windows are drawn until LAYR-3 is kept: a window of one frame
does that in every bucket that is no shorter than a frame."""

import math
import struct

from times import bucket_bits, bucket_of_phase

LEAST_SIGMA = 1e-6                  # of section 16
NO_BOUNDS = (0xFBFF,) * 3 + (0x7BFF,) * 3


class NoLegalValue(Exception):
    """The coding has no code for a mean time that is legal in the bucket."""


class Window:
    """A bucket of a layer, in seconds."""

    def __init__(self, scene, level, bucket=0):
        duration = float(scene["num_frames"] * scene["fps_den"]) / scene["fps_num"]
        self.begin, self.end = scene["time_begin"], scene["time_begin"] + duration
        self.level, self.bucket, self.width = level, bucket, duration / (1 if level == 0 else 2 << level)
        self.center = self.begin + (bucket + 0.5) * self.width
        self.reach = self.width / 4

    def is_usable(self):
        """Whether the layer can hold Gaussians at all: its buckets are no shorter than these are visible, and
        binary64 tells times in them apart."""
        return self.width > 100 * LEAST_SIGMA and self.width > 1e-9 * max(abs(self.begin), abs(self.end))

    def most_log_scale(self):
        # -0.01: for the rounding of log, of binary32, and of sigma.
        return min(math.floor((math.log(self.width / 16) - 0.01) * 1024) / 1024, 17.0)

    def allows(self, mean):
        margin = self.reach * 1.01
        return (self.level == 0 or abs(mean - self.center) <= 0.7 * self.width or
                mean + margin < self.begin or mean - margin > self.end)

    def begins(self, frames):
        """Flat windows that begin later, in frames after the first that a code can say, reach too far."""
        return (3 * frames >> bucket_bits(self.level)) + 2

    def holds(self, phases):
        """LAYR-3"""
        return all(abs(bucket_of_phase(phase, self.level) - self.bucket) <= 1 for phase in phases)

    def visible(self, rng, shown):
        """visible_begin and visible_end of a page; `shown`: when each of its Gaussians may be visible."""
        first, last = math.inf, -math.inf
        for begin, end in shown:
            begin, end = max(begin, self.begin), min(end, self.end)
            if begin <= end:
                first, last = min(first, begin), max(last, end)
        unit = self.width / 64
        low = 128 if first > last else math.floor((first - self.center) / unit + 128 - 1e-6)
        high = 128 if first > last else math.ceil((last - self.center) / unit + 128 + 1e-6)
        low, high = low - rng.choice([0, 0, 1, 9]), high + rng.choice([0, 0, 1, 9])
        return max(low, 0), min(high, 255)


def half_below(x):
    """The bits of a binary16 that is x or a little less."""
    bits = struct.unpack("<H", struct.pack("<e", x))[0]
    value = struct.unpack("<e", struct.pack("<e", x))[0]
    if value <= x:
        return bits
    if value > 0:
        return bits - 1
    return 0x8001 if bits & 0x7FFF == 0 else bits + 1


def half_above(x):
    return half_below(-x) ^ 0x8000


def box(columns, unit):
    """Bounds of coded positions, columns x y z, each divided by `unit`."""
    low, high = [min(c) / unit for c in columns], [max(c) / unit for c in columns]
    if max(map(abs, low + high)) > 65000:
        return NO_BOUNDS
    return tuple(half_below(v - 1e-5 * abs(v)) for v in low) + tuple(half_above(v + 1e-5 * abs(v)) for v in high)

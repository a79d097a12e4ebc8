#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The rules of section 15.6 against exact rational arithmetic: frames of times, windows that tile
time, and the buckets that hold what is visible. The library's own arithmetic is compared with
conformance/reference in streams_test.py and in tests/math."""

import math
import random
import sys
import unittest
from fractions import Fraction
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "conformance" / "reference"))

from times import (bucket_of_phase, frame_of_time, num_buckets, phase_of_time,     # noqa: E402
                   phases_of_window, tells_frames_apart, window_base)

RATES = ((30, 1), (30000, 1001), (24, 1), (60, 1), (240, 1), (1, 1), (7, 3), (1, 2 ** 32 - 5),
         (2 ** 32 - 1, 2 ** 32 - 5), (2 ** 32 - 1, 1), (3, 2 ** 32 - 1))
FRAMES = (1, 2, 3, 7, 30, 32, 300, 65537, (1 << 24) - 1, 1 << 24)
BEGINS = (0.0, -2.5, 12.34, 1.7e9)
RNG = random.Random(1)


def timelines():
    for num, den in RATES:
        for n in FRAMES:
            for begin in BEGINS:
                h = {"time_begin": begin, "num_frames": n, "fps_num": num, "fps_den": den}
                if tells_frames_apart(h):
                    yield h


def time_of_frame(h, k):
    """As a player computes it, in binary64."""
    return h["time_begin"] + float(k) * float(h["fps_den"]) / float(h["fps_num"])


def exact_frames(h, t):
    return (Fraction(t) - Fraction(h["time_begin"])) * h["fps_num"] / h["fps_den"]


def some_frames(h):
    n = h["num_frames"]
    return sorted({0, min(1, n - 1), min(2, n - 1), n // 2, max(n - 2, 0), n - 1,
                   *(RNG.randrange(n) for _ in range(12))})


class Frames(unittest.TestCase):
    # spec: LAYR-2
    def test_the_time_of_a_frame_is_in_that_frame(self):
        count = 0
        for h in timelines():
            for k in some_frames(h):
                self.assertEqual(frame_of_time(h, time_of_frame(h, k)), k, (h, k))
                count += 1
            self.assertEqual(frame_of_time(h, time_of_frame(h, h["num_frames"])), h["num_frames"] - 1)
        self.assertGreater(count, 3000)

    def test_other_times_are_in_the_frame_that_exact_arithmetic_says(self):
        """But for those that are nearer to a border than binary64 tells there."""
        decided = undecided = 0
        for h in timelines():
            slack = Fraction(1, 2048)
            # What a time may be off, in frames.
            unsure = Fraction(math.ulp(max(abs(h["time_begin"]), abs(time_of_frame(
                h, h["num_frames"]))))) * h["fps_num"] / h["fps_den"] + Fraction(1, 1 << 24)
            for k in some_frames(h):
                for part in (-0.0007, -0.0004, 0.0003, 0.25, 0.5, 0.9993, 0.9996):
                    t = time_of_frame(h, k + part)
                    frames = exact_frames(h, t)
                    least = math.floor(frames + slack - unsure)
                    if least != math.floor(frames + slack + unsure):
                        undecided += 1
                        continue
                    want = min(max(least, 0), h["num_frames"] - 1)
                    self.assertEqual(frame_of_time(h, t), want, (h, k, part))
                    decided += 1
        self.assertGreater(decided, 20 * undecided)

    def test_frames_never_go_back(self):
        for h in timelines():
            end = time_of_frame(h, h["num_frames"])
            times = sorted(RNG.uniform(h["time_begin"] - 1e-3, end + 1e-3) for _ in range(50))
            frames = [frame_of_time(h, t) for t in times]
            self.assertEqual(frames, sorted(frames))


class Windows(unittest.TestCase):
    # spec: LAYR-2
    def test_windows_tile_time(self):
        """At every time, one of the windows that share the sequence is open, and no other."""
        for h in timelines():
            n = h["num_frames"]
            cuts = sorted({0, n, *(RNG.randrange(n + 1) for _ in range(min(n, 9)))})
            windows = list(zip(cuts, cuts[1:]))
            times = [time_of_frame(h, k) for k in cuts]
            times += [math.nextafter(t, s) for t in times for s in (-math.inf, math.inf)]
            times += [time_of_frame(h, RNG.uniform(-0.1, n + 0.1)) for _ in range(20)]
            times += [-math.inf, math.inf]
            for t in times:
                frame = frame_of_time(h, t)
                self.assertEqual(sum(b <= frame < e for b, e in windows), 1, (h, t))

    # spec: LAYR-3, LAYR-2
    def test_buckets_of_a_query_hold_what_is_visible(self):
        """The theorem of section 15.6, for windows in every bucket that LAYR-3 allows."""
        placed = 0
        for h in timelines():
            n, levels = h["num_frames"], (h["num_frames"] - 1).bit_length() + 1
            for _ in range(12):
                level = RNG.randrange(levels)
                most = max(1, int(n / 2 ** level))
                begin = RNG.choice([0, RNG.randrange(n), n - 1])
                end = min(n, begin + RNG.choice([1, most, RNG.randint(1, most)]))
                phases = phases_of_window(h, (begin, end))
                first, last = (bucket_of_phase(p, level) for p in phases)
                for bucket in range(max(last - 1, 0), min(first + 1, num_buckets(level) - 1) + 1):
                    placed += 1
                    self.assertLessEqual(window_base(h, level, bucket), begin)
                    times = [time_of_frame(h, k) for k in (begin - 0.0006, begin - 0.0004, begin,
                                                           (begin + end) / 2, end - 0.0006, end)]
                    times += [math.nextafter(t, s) for t in times for s in (-math.inf, math.inf)]
                    for t in times:
                        if begin <= frame_of_time(h, t) < end:
                            near = bucket_of_phase(phase_of_time(h, t), level)
                            self.assertLessEqual(abs(near - bucket), 1, (h, level, begin, end, t))
        self.assertGreater(placed, 1500)

    # spec: LAYR-3
    def test_single_frames_fit_the_finest_level(self):
        """Of sequences of 2^j frames, in the bucket in which the frame begins."""
        for j in (0, 1, 5, 12, 24):
            h = {"num_frames": 1 << j}
            for k in {0, (1 << j) // 3, (1 << j) - 1}:
                buckets = [bucket_of_phase(p, j) for p in phases_of_window(h, (k, k + 1))]
                self.assertTrue(all(abs(b - (2 * k if j else 0)) <= 1 for b in buckets))


if __name__ == "__main__":
    unittest.main()

# SPDX-License-Identifier: Apache-2.0
"""Buckets, phases and visible intervals: section 15 of spec/l4d.md, in binary64."""

import math

LAST_PHASE = (1 << 40) - 1


def bucket_bits(level):
    return 0 if level == 0 else level + 1


def num_buckets(level):
    return 1 << bucket_bits(level)


def directory_pages(level, directory_bits):
    return -(-num_buckets(level) // (1 << int(directory_bits)))


def duration(h):
    return float(h["num_frames"] * h["fps_den"]) / h["fps_num"]


def width_of_bucket(h, level):
    return duration(h) / num_buckets(level)


def center_of_bucket(h, level, bucket):
    return h["time_begin"] + (bucket + 0.5) * width_of_bucket(h, level)


def clamp_time(h, t):
    return min(max(t, h["time_begin"]), h["time_begin"] + duration(h))


def phase_of_frame(h, k):
    return LAST_PHASE if k >= h["num_frames"] else (k << 40) // h["num_frames"]


def frames_of_time(h, t):
    return (t - h["time_begin"]) * float(h["fps_num"]) / float(h["fps_den"])


def phase_of_time(h, t):
    frames = frames_of_time(h, t)
    n = h["num_frames"]
    if not frames > 0:
        return 0
    if frames >= n:
        return LAST_PHASE
    k = math.floor(frames + 0.5)
    if abs(frames - k) < 1e-6:
        return phase_of_frame(h, k)
    return min(math.floor(frames / n * 2.0 ** 40), LAST_PHASE)


def frame_of_time(h, t):
    """The frame that a time belongs to: section 15.6."""
    frames, last = frames_of_time(h, t), h["num_frames"] - 1
    if not frames > 0:
        return 0
    return last if frames >= h["num_frames"] else min(math.floor(frames + 2.0 ** -11), last)


def tells_frames_apart(h):
    """WIND-2"""
    farthest = abs(h["time_begin"]) + duration(h)
    return farthest * float(h["fps_num"]) / float(h["fps_den"]) <= 2.0 ** 40


def window_base(h, level, bucket):
    """What coded begins of windows count from."""
    return max(bucket - 1, 0) * h["num_frames"] >> bucket_bits(level)


def window_middle(h, window):
    """The exact mean time of a Gaussian with a window."""
    total = float(sum(window))
    return h["time_begin"] + total * float(h["fps_den"]) / float(h["fps_num"]) * 0.5


def window_times(h, window):
    """The times outside which a window is closed (DIR-9)."""
    begin, end = window
    first = begin - 2.0 ** -10 if begin else 0.0
    return [h["time_begin"] + frame * float(h["fps_den"]) / float(h["fps_num"])
            for frame in (first, float(end))]


def phases_of_window(h, window):
    """The phases that LAYR-3 is about."""
    begin, end = window
    first = max(phase_of_frame(h, begin) - (1 << 30) // h["num_frames"], 0)
    return first, LAST_PHASE if end >= h["num_frames"] else phase_of_frame(h, end) - 1


def bucket_of_phase(phase, level):
    return phase >> 40 - bucket_bits(level)


def buckets_of_query(h, level, begin, end):
    """The first and last bucket of a level that the times from begin to end need."""
    first = bucket_of_phase(phase_of_time(h, clamp_time(h, begin)), level)
    last = bucket_of_phase(phase_of_time(h, clamp_time(h, end)), level)
    return max(first - 1, 0), min(last + 1, num_buckets(level) - 1)


def visible_interval(h, level, record):
    """The times that visible_begin and visible_end of a page record stand for."""
    width = width_of_bucket(h, level)
    center = center_of_bucket(h, level, record["bucket"])
    return [center + (record[key] - 128) * (width / 64) for key in ("visible_begin", "visible_end")]


def may_be_visible(h, layer, record, begin, end):
    """Whether a query of times from begin to end has to read the page."""
    first, last = visible_interval(h, layer["level"], record)
    return layer["permanent"] or (clamp_time(h, end) >= first and clamp_time(h, begin) <= last)

# SPDX-License-Identifier: Apache-2.0
"""Streams of a few Gaussians in binary32, for tests about what attributes mean."""

import math
import struct

import generator_path           # its import makes the following ones possible
import stream_builder as sb
import make_tiny
from broken_streams import FIRST

NO_BOUNDS = (0xFBFF,) * 3 + (0x7BFF,) * 3
RAW = {"coding": 1}


def f32(x):
    return struct.unpack("<f", struct.pack("<f", x))[0]


def raw_column(values):
    return make_tiny.packed([sb.order32(v) for v in values], 32)


def stream(gaussians, num_frames=10, fps=10, **header):
    """gaussians: rows by name, as decode_tiny.decode gives them; in one bucket of level 0."""
    columns = lambda name: [raw_column(c) for c in zip(*(g[name] for g in gaussians))]
    order = ("position", "mean_t", "opacity", "sh", "log_scale", "rotor")
    page = {"num_gaussians": len(gaussians), "bucket": 0, "block": sb.NO_BLOCK, "visible_begin": 0,
            "visible_end": 255, "bounds": NO_BOUNDS, "reserved": 0,
            "raw": b"".join(c for name in order for c in columns(name))}
    layer = {"level": 0, "permanent": False, "mean_t": 1, "num_gaussians": len(gaussians),
             "log_scale_t": 0.0, "directory_bits": 0, "table_size": 1, "blocks": {}, "pages": [page],
             "scale_factor": {"coding": 0, "bits": 0, "offset": 0.0, "step": 0.0},
             "scale": RAW, "rotor_spatial": RAW, "rotor_temporal": RAW}
    return sb.build({"num_gaussians": len(gaussians), "time_begin": 0.0, "num_frames": num_frames,
                     "fps_num": fps, "fps_den": 1, "origin": {}, "position": 1,
                     "position_center": {}, "position_scale": 1.0, "opacity": RAW, "sh": RAW,
                     "sh_degree": math.isqrt(len(gaussians[0]["sh"]) // 3) - 1, "layers": [layer],
                     **header}, rng=FIRST)

# SPDX-License-Identifier: Apache-2.0
"""The rules of the scene header, section 8 of spec/l4d.md."""

import math
import struct

from arithmetic import bit_width, require, sound
from times import directory_pages, tells_frames_apart

SH, SCALE, ROTOR_SPATIAL, ROTOR_TEMPORAL = range(4)
COMPONENTS = ("sh", "scale", "rotor_spatial", "rotor_temporal")
CONSTANT, RAW32, SQ = range(3)      # scalar-coding
ZERO, _, VQ, TRANSFORM = range(4)   # component-coding; 1 is RAW32
NONE, _, F16, FIXED, RAW64, WINDOW = range(6)   # coordinate-coding; 1 is RAW32


def component(h, layer, c):
    """The coding of component c in a layer, of which the number is given."""
    return h["sh"] if c == SH else h["layers"][layer][COMPONENTS[c]]


def vector_length(h, layer, c):
    """How many numbers the vectors of a component have."""
    if c == SH:
        return 3 * (int(h["sh_degree"]) + 1) ** 2
    if c == SCALE:
        return 3 if h["layers"][layer]["permanent"] else 4
    return 3 if component(h, layer, c)["coding"] == TRANSFORM else 4


def position_coding(h, layer):
    return RAW32 if h["layers"][layer]["raw_position"] else h["position"]


def has_fine_mean_times(layer):
    return bool(layer["mean_t"] == FIXED and layer["mean_t_fine"])


def window_columns(layer):
    """(name, bits) of the columns of windows: section 13.1."""
    columns = []
    for what in ("begin", "length"):
        bits = int(layer[f"window_{what}_bits"])
        columns += [(f"window_{what}", min(bits, 16)), (f"window_{what}_high", bits - min(bits, 16))]
    return columns


def has_depth(coding):
    """Whether a page tells the depths of a vq component."""
    return len(coding["stages"]) > 1 or bool(coding["escapes"])


def has_detail(h):
    """DIR-13: whether rans32 pages can have SH chunks."""
    return h["sh"]["coding"] == VQ or (h["sh"]["coding"] == TRANSFORM and
                                       h["sh_base"] < len(h["sh"]["steps"]))


def check_header(h, header_bytes, needs_are_shown=False):
    """Raises Invalid where a rule of section 8 is broken. needs_are_shown: the members that the stream needs are
    shown with it."""
    require(1 <= h["num_frames"] <= 1 << 24 and h["fps_num"] and h["fps_den"], "HEAD-2", "timeline")
    require(all(map(sound, [h["time_begin"], *h["position_center"].values()])) and
            sound(h["position_scale"]) and h["position_scale"] > 0 and
            all(map(math.isfinite, [h["world_scale"], *h["origin"].values()])), "HEAD-3", "range")
    require(0 < h["gate"] <= 16, "HEAD-9", "gate")
    require(h["sh_degree"] <= 3, "HEAD-4", "sh_degree")
    require(h["position"] <= WINDOW, "HEAD-7", "position")
    require(h["position"] not in (NONE, RAW64, WINDOW), "HEAD-16", "position")
    require(h["position"] != FIXED or 1 <= h["position_bits"] <= 21, "CODE-5", "position_bits")
    check_scalar(h["opacity"])
    check_component(h["sh"], 3 * (int(h["sh_degree"]) + 1) ** 2, rcq=False)
    most = len(h["sh"]["steps"]) if h["sh"]["coding"] == TRANSFORM else 0
    require(h["sh_base"] <= most, "TRAN-7", f"sh_base {h['sh_base']}")
    levels = bit_width(h["num_frames"]) + 1
    require(1 <= len(h["layers"]) <= 4 * levels + 2, "HEAD-6", "number of layers")
    level = 0
    for layer in h["layers"]:
        require(level <= layer["level"] < levels, "HEAD-6", "level")
        level = layer["level"]
        require(layer["mean_t"] <= WINDOW, "HEAD-7", "mean_t")
        require(layer["mean_t"] != F16 or layer["mean_t_shift"] <= 10, "CODE-6", "mean_t_shift")
        if layer["mean_t"] == FIXED:
            require(1 <= layer["mean_t_bits"] <= 16, "TIME-1", "mean_t_bits")
            require(2.0 ** -60 <= layer["mean_t_step"] <= 2.0 ** 60, "TIME-2", "mean_t_step")
        if layer["mean_t"] == WINDOW:
            require(layer["window_begin_bits"] <= 24 and layer["window_length_bits"] <= 24 and
                    layer["window_length"] <= 1 << 24, "WIND-1", "window")
            require(tells_frames_apart(h), "WIND-2", "windows over 2^40 frames from time 0")
        require(layer["permanent"] == (layer["mean_t"] == NONE) and
                not (layer["permanent"] and level), "HEAD-10", "permanent layer")
        require(sound(layer["log_scale_t"]), "HEAD-3", "log_scale_t")
        check_scalar(layer["scale_factor"])
        require(layer["scale_factor"]["coding"] != RAW32 or layer["scale"]["coding"] == RAW32,
                "HEAD-14", "raw scale_factor")
        check_component(layer["scale"], 3 if layer["permanent"] else 4, rcq=level > 0)
        for name in ("rotor_spatial", "rotor_temporal"):
            check_component(layer[name], 3, rcq=level > 0, most_step=1.0)
        spatial, temporal = layer["rotor_spatial"]["coding"], layer["rotor_temporal"]["coding"]
        require(temporal != RAW32 or spatial == RAW32, "HEAD-11", "raw temporal rotor")
        require(temporal != TRANSFORM or spatial == TRANSFORM, "HEAD-15", "temporal transform")
        require(spatial != TRANSFORM or temporal in (TRANSFORM, ZERO), "HEAD-15", "temporal rotor")
        require(layer["directory_bits"] <= 16 and
                directory_pages(level, int(layer["directory_bits"])) <= 1 << 20,
                "HEAD-12", "directory_bits")
    total = sum(layer["num_gaussians"] for layer in h["layers"])
    require(total == h["num_gaussians"], "HEAD-5", "sum of num_gaussians")
    require(not any(e["critical"] and not (needs_are_shown and e["id"] == 1) for e in h["extensions"] or ()),
            "HEAD-8", "extension")
    errors = h["errors"]
    require(errors is None or errors["covariance"] >= 1 and
            all(0 <= v < math.inf for v in errors.values()), "HEAD-18", "errors")
    if h["rendering"] is not None:
        check_rendering(h["rendering"])
    if h["presentation"] is not None:
        check_presentation(h["presentation"])
    texts = [m[key] for m in h["metadata"] or () for key in ("key", "value")]
    require(sum(len(t.encode("utf-8")) for t in texts) <= header_bytes, "HEAD-13", "metadata")


def binary32(v):
    return struct.unpack("<f", struct.pack("<f", v))[0]


def check_rendering(r):
    require(0 <= r["dilation"] <= 16, "HEAD-19", "dilation")
    require(r["cutoff"] == 0 or 1 <= r["cutoff"] <= 16, "HEAD-19", "cutoff")
    require(binary32(1 / 255) <= r["min_alpha"] <= 0.25, "HEAD-19", "min_alpha")
    require(0.5 <= binary32(r["max_alpha"]) <= binary32(0.999), "HEAD-19", "max_alpha")


def check_presentation(p):
    bounds, camera = p["bounds"], p["camera"]
    require(0 <= p["metres_per_unit"] < math.inf, "HEAD-20", "metres_per_unit")
    if bounds is not None:
        require(all(math.isfinite(v) for v in bounds["min"] + bounds["max"]) and
                all(a <= b for a, b in zip(bounds["min"], bounds["max"])), "HEAD-20", "bounds")
    if camera is None:
        return
    require(all(math.isfinite(v) for key in ("position", "target", "up") for v in camera[key]),
            "HEAD-20", "camera")
    f = [b - a for a, b in zip(camera["position"], camera["target"])]
    u = camera["up"]
    cross = (f[1] * u[2] - f[2] * u[1], f[2] * u[0] - f[0] * u[2], f[0] * u[1] - f[1] * u[0])
    area = cross[0] * cross[0] + cross[1] * cross[1] + cross[2] * cross[2]
    require(0 < area < math.inf and 0 < camera["fov"] < 3, "HEAD-20", "camera")


def check_scalar(s):
    require(s["coding"] <= SQ, "HEAD-7", "scalar coding")
    require(sound(s["offset"]) and sound(s["step"]), "HEAD-3", "offset or step")
    require(s["coding"] != SQ or 1 <= s["bits"] <= 16, "CODE-1", "bits")


def check_component(c, dim, rcq, most_step=2.0 ** 10):
    require(c["coding"] <= TRANSFORM, "HEAD-7", "component coding")
    if c["coding"] == TRANSFORM:
        check_transform(c, dim, most_step)
    if c["coding"] != VQ:
        return
    require(1 <= len(c["stages"] or ()) <= 8, "CODE-3", "stages")
    require(rcq or c["rcq"] is None, "RCQ-2", "RCQ")
    stages = [(s, 65536) for s in c["stages"]]
    for stage, most in stages if c["rcq"] is None else [*stages, (c["rcq"], 4096)]:
        require(1 <= stage["num_entries"] <= most, "CODE-2", "entries")
        check_element(stage)


def check_element(stage):
    require(stage["element"] <= 1, "HEAD-7", "element")
    require(stage["element"] == 0 or 2.0 ** -20 <= stage["step"] <= 2.0 ** 10, "CODE-7", "step")


def check_transform(c, dim, most_step):
    """dim: of the vectors of a transform."""
    steps, eob_table, basis = c["steps"] or [], c["eob_table"] or [], c["basis"]
    require(1 <= len(steps) <= dim, "TRAN-1", f"{len(steps)} steps")
    require(all(2.0 ** -20 <= s <= most_step for s in steps), "TRAN-2", "steps")
    require(eob_table and all(a < b for a, b in zip([0, *eob_table], eob_table)) and
            eob_table[-1] == len(steps), "TRAN-3", "eob_table")
    require(basis is not None and basis["num_entries"] == len(steps) + 1, "TRAN-4", "basis")
    check_element(basis)
    require(basis["element"] == 0, "TRAN-8", "basis element")

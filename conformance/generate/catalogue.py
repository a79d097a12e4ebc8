# SPDX-License-Identifier: Apache-2.0
"""The legal vectors: which random scenes, and what each is for. core: one feature after another, what every
decoder must decode. uncommon: corners that are legal and rare."""

import broken_rans
import broken_streams
import corners
import make_tiny
import member_files
import stream_builder as sb
from random_coding import transform, vq
from random_page import F16, FIXED, NONE, RAW32, RAW64, VQ, WINDOW, ZERO
from random_stream import RandomScene

ALWAYS = {"version": (1, 0), "flags": 1, "unknown_fields": False, "header_last": False}
NOTHING = {"metadata": [], "extensions": [], "errors": None, "rendering": None, "presentation": None,
           "gate": 16.0, "coordinate_system": 1, "color_space": 0}
SECONDS = {"num_frames": 30, "fps_num": 30, "fps_den": 1, "time_begin": 0.0}
SQ = lambda bits: {"coding": 2, "bits": bits, "offset": -0.25, "step": 0.75 / (1 << bits - 1)}
CONSTANT = {"coding": 0, "bits": 0, "offset": 0.5, "step": 0.0}
RAW = {"coding": 1, "bits": 0, "offset": 0.0, "step": 0.0}
CODED = {"coding": ZERO}


class Vector:
    """A file of the suite. kind: how it is made, for people."""

    def __init__(self, group, name, about, data, clauses=(), made_by="", **more):
        self.group, self.name, self.about, self.data = group, name, about, data
        self.clauses, self.made_by, self.more = list(clauses), made_by, more

    def path(self):
        return f"{self.group}/{self.name}.l4d"


def plain(seed, scene=None, layer=None, levels=(0, 1, 2), build=None, **options):
    """A scene of 30 frames without anything that is not given."""
    base = {**NOTHING, **SECONDS, "position": F16, "position_center": {}, "position_scale": 1.0,
            "opacity": SQ(8), "opacity_logit": False, "position_at_mean_time": False, "sh_degree": 1,
            "sh": lambda r, dim: vq(r, dim, stages=1, escapes=False, tame=True), **(scene or {})}
    return RandomScene(seed, may_be_raw=False, scene=base, layer=quiet(layer), levels=list(levels),
                       **{"zstd": 0, "forms": "streams", "sizes": [33, 65, 90], **options},
                       build={**ALWAYS, **(build or {})}).build()


def quiet(layer):
    """Fields of a layer: of one codebook each where nothing else is given."""
    codebook = lambda r, dim, rcq: vq(r, dim, stages=1, escapes=False, tame=True)
    base = {"scale": codebook, "rotor_spatial": codebook, "rotor_temporal": codebook,
            "scale_factor": dict(CONSTANT), "mean_t_shift": 0, "raw_position": False, "log_scale_t": 1.0}

    def fields(level):
        given = layer(level) if callable(layer) else layer or {}
        permanent = given.get("permanent", False)
        out = {**base, "permanent": permanent, "mean_t": NONE if permanent else F16, **given}
        return {key: dict(value) if isinstance(value, dict) else value for key, value in out.items()}
    return fields


def codings():
    """(name, about, scene, layer, options): one coding at a time"""
    codebook = lambda **more: lambda r, dim, rcq=False: vq(r, dim, may_have_rcq=rcq, tame=True, **more)
    change = lambda **more: lambda r, dim, rcq=False: transform(r, dim, 1.0, **more)
    turn = lambda r, dim, rcq: transform(r, 3, 1.0)
    raws = {"scale": {"coding": RAW32}, "rotor_spatial": {"coding": RAW32},
            "rotor_temporal": {"coding": RAW32}}
    yield "position-f16", "positions of binary16, a centre and a scale", {
        "position_center": {"x": 1.5, "y": -2.0, "z": 0.125}, "position_scale": 0.37}, {}, {}
    for bits in (8, 16):
        yield f"position-fixed-{bits}", f"fixed positions of {bits} bits", {
            "position": FIXED, "position_bits": bits, "position_scale": 2.0 ** -8}, {}, {}
    yield "position-raw32", "positions of binary32", {"position": RAW32}, {}, {}
    yield "position-of-layer-raw", "a layer with raw_position among fixed ones", {
        "position": FIXED, "position_bits": 14}, lambda level: {"raw_position": level == 1}, {}
    yield "mean-none", "a permanent layer beside others", {}, lambda level: {"permanent": level == 0}, {}
    for shift in (1, 7):
        yield f"mean-f16-shift-{shift}", f"mean times without their {shift} low bits", {}, {
            "mean_t_shift": shift}, {}
    fixed = {"mean_t": FIXED, "mean_t_bits": 9, "mean_t_zero": 256, "mean_t_step": 0.0001}
    yield "mean-fixed", "mean times of 9 bits", {}, {**fixed, "mean_t_fine": False}, {}
    yield "mean-fixed-fine", "mean times of 9 bits with refinements", {}, {**fixed, "mean_t_fine": True}, {}
    yield "mean-raw32", "mean times of binary32", {}, {"mean_t": RAW32}, {}
    yield "mean-raw64", "mean times of binary64", {"time_begin": 1.7e9}, {"mean_t": RAW64}, {}
    flat = {"mean_t": WINDOW, "window_begin_bits": 6, "window_length_bits": 5, "window_length": 1}
    yield "window", "flat windows in place of mean times", {}, flat, {}
    yield "window-rans", "flat windows in rANS pages", {}, flat, {"forms": "rans"}
    yield "window-and-mean-time", "layers of flat windows beside others", {}, lambda level: (
        flat if level == 1 else {"permanent": level == 0}), {"levels": [0, 0, 1, 1, 2]}
    yield "window-of-one-length", "windows of one frame each: lengths of no bits", {}, {
        **flat, "window_length_bits": 0}, {}
    yield "opacity-constant", "one opacity for all", {"opacity": CONSTANT}, {}, {}
    yield "opacity-clamped", "opacity codes that stand for less than 0 and more than 1", {
        "opacity": SQ(12)}, {}, {}
    yield "opacity-logit", "logits of opacities", {"opacity": SQ(10), "opacity_logit": True}, {}, {}
    yield "opacity-raw32", "opacities of binary32", {"opacity": RAW}, {}, {}
    yield "scale-factor-sq", "scale factors of 7 bits", {}, {"scale_factor": SQ(7)}, {}
    for degree in range(4):
        yield f"sh-degree-{degree}", f"SH of degree {degree}, a codebook", {"sh_degree": degree}, {}, {}
    yield "sh-zero", "no SH", {"sh": {"coding": ZERO}}, {}, {}
    yield "sh-raw32", "SH of binary32", {"sh": {"coding": RAW32}, "sh_degree": 2}, {}, {}
    for stages in (2, 8):
        yield f"sh-stages-{stages}", f"{stages} stages, depths 0 to {stages}", {
            "sh": codebook(stages=stages, escapes=False)}, {}, {}
    yield "sh-escapes", "vectors of SH that use no codebook", {
        "sh": codebook(stages=1, escapes=True), "sh_degree": 3}, {}, {}
    yield "sh-integer-codebook", "codebooks of multiples of a step", {"sh": multiples}, {}, {}
    yield "sh-transform", "SH as coefficients of a basis", {"sh": change(), "sh_degree": 3}, {}, {}
    yield "all-codebooks", "all components of codebooks with stages and escapes", {"sh": codebook()}, {
        "scale": codebook(), "rotor_spatial": codebook(), "rotor_temporal": codebook()}, {"forms": None}
    yield "all-transforms", "all components are transforms", {"sh": change(), "sh_base": 1}, {
        "scale": change(), "rotor_spatial": turn, "rotor_temporal": turn}, {"forms": None}
    yield "rotor-transform-static", "stereographic rotors without a temporal part", {}, {
        "rotor_spatial": turn, "rotor_temporal": CODED}, {}
    yield "no-motion", "no temporal rotors: Gaussians stay where they are", {}, {"rotor_temporal": CODED}, {}
    yield "block-codebooks", "residual codebook quantisation", {}, {
        name: codebook(stages=2) for name in sb.COMPONENTS}, {"buckets": 8}
    yield "lossless", "everything of binary32 and binary64", {
        "position": RAW32, "opacity": RAW, "sh": {"coding": RAW32}, "sh_degree": 1}, {
            **raws, "mean_t": RAW32, "scale_factor": RAW}, {}
    yield "rans", "rANS pages of codebooks", {"position": FIXED, "position_bits": 12, "sh": codebook()}, {
        **fixed, "mean_t_fine": False}, {"forms": "rans"}
    yield "rans-transform", "rANS pages with contexts and two parts", {
        "sh": change(number=9), "sh_base": 4, "sh_degree": 2, "position": FIXED, "position_bits": 16}, {
            "scale": change(), "rotor_spatial": turn, "rotor_temporal": turn}, {"forms": "rans"}
    yield "zstd-chunks", "chunks that are zstd frames", {}, {}, {"zstd": 1}


def multiples(r, dim):
    return {"coding": VQ, "escapes": False, "stages": [
        sb.Multiples([[r.randint(-300, 300) for _ in range(dim)] for _ in range(17)], 2.0 ** -7)]}


def core():
    yield Vector("core", "tiny", "the worked example of appendix A", make_tiny.make(),
                 ["DEC-1", "DEC-2"], "spec/examples/make_tiny.py")
    for seed, (name, about, scene, layer, options) in enumerate(codings(), 1000):
        yield Vector("core", name, about, plain(seed, scene, layer, **options),
                     ["DEC-1", "DEC-2", "PAGE-2", "PAGE-3", *CLAUSES_OF.get(name, [])],
                     f"random scene, seed {seed}")
    for name, data in [("two-layers", sb.build(broken_streams.scene(), rng=broken_streams.FIRST)),
                       *((n.replace(" ", "-").lower(), d) for n, d in broken_rans.valid())]:
        yield Vector("core", f"base-{name}", "what the faulty vectors are made of: it breaks no rule", data,
                     ["DEC-1", "DEC-2"], "broken_streams.py, broken_rans.py")


CLAUSES_OF = {"sh-transform": ["DEC-7"], "rans-transform": ["DEC-7"], "all-transforms": ["DEC-7"],
              "mean-none": ["LAYR-2"], "window": ["LAYR-2", "LAYR-3"], "block-codebooks": ["LAYR-2"]}
NUM_MIXED = 60


def uncommon():
    yield from (Vector("uncommon", *rest) for rest in (*corners.corners(plain), *corners.by_hand()))
    yield Vector("uncommon", "times-of-frames", "queries for frames whose times binary64 rounds down",
                 plain(2999, corners.NTSC, levels=[0, 1, 2, 3, 4], sizes=[2, 3], buckets=20, loose=True),
                 ["LAYR-2"], "random scene, seed 2999", times=[*list(corners.times_of_frames())[:4], corners.BEFORE_THE_END])
    for name, about, data, clauses in member_files.valid():
        yield Vector("uncommon", name, about, data, clauses, "member_files.py")
    for seed in range(NUM_MIXED):
        yield Vector("uncommon", f"mixed-{seed:02}", "all codings in one random scene", RandomScene(seed).build(),
                     ["DEC-1", "DEC-2", "DEC-7", "PAGE-2", "PAGE-3", "STRM-5", "LAYR-2", "VER-1", "VER-2"],
                     f"random scene, seed {seed}")

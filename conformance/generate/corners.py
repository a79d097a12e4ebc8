# SPDX-License-Identifier: Apache-2.0
"""Corners of the format that are legal and rare, one for each vector."""

import broken_levels as bl
import frames
import stream_builder as sb
from make_tiny import constant, order
from random_coding import transform, vq
from random_page import FIXED, RAW32, WINDOW

MANY_FRAMES = {"num_frames": 1 << 24, "fps_num": 30, "fps_den": 1}
FULL = (1 << 32) - 1


def corners(plain):
    """(name, about, file, clauses, how it is made); plain: catalogue.plain"""
    seed = [2000]

    def made(name, about, clauses, scene=None, layer=None, **options):
        seed[0] += 1
        return (name, about, plain(seed[0], scene, layer, **options), clauses,
                f"random scene, seed {seed[0]}")

    codebook = lambda **more: lambda r, dim, rcq=False: vq(r, dim, may_have_rcq=rcq, tame=True, **more)
    yield made("one-frame", "a sequence of one frame", ["HEAD-2"], {"num_frames": 1}, levels=[0, 0])
    yield made("frames-2-to-24", "2^24 frames, buckets of level 24 and 512 directory pages",
               ["HEAD-2", "HEAD-6"], MANY_FRAMES,
               lambda level: {"directory_bits": 16 if level == 24 else min(level, 9)},
               levels=[0, 3, 12, 24], sizes=[5, 33])
    yield made("directory-bits-16", "directory pages of 65536 buckets", ["HEAD-12"], MANY_FRAMES,
               lambda level: {"directory_bits": 16}, levels=[0, 17, 20])
    yield made("fps-den-near-2-to-32", "a frame rate of 4294967295 / 4294967291", ["HEAD-2", "LAYR-2"],
               {"fps_num": FULL, "fps_den": FULL - 4, "num_frames": 7}, levels=[0, 1, 2])
    yield made("one-frame-in-136-years", "frames of 4294967295 seconds", ["HEAD-2"],
               {"fps_num": 1, "fps_den": FULL, "num_frames": 3, "time_begin": -2.0 ** 33}, levels=[0, 1])
    yield made("windows-of-24-bits", "flat windows among 2^24 frames, whose codes take two columns",
               ["WIND-1", "WIND-3", "LAYR-3"], MANY_FRAMES,
               {"mean_t": WINDOW, "window_begin_bits": 24, "window_length_bits": 24, "window_length": 0},
               levels=[0, 1, 9], forms=None)
    yield made("windows-far-away", "flat windows at the latest times at which binary64 tells frames apart",
               ["WIND-2", "LAYR-2"], {"time_begin": 2.0 ** 35, "num_frames": 32, "fps_num": 30},
               {"mean_t": WINDOW, "window_begin_bits": 6, "window_length_bits": 6, "window_length": 0},
               levels=[0, 1, 2])
    yield made("empty-layers", "layers without Gaussians between others", ["LAYR-2"],
               layer=lambda level: {}, levels=[0, 0, 1, 1, 2, 2], forms=None, buckets=1)
    yield made("most-layers", "as many layers as 30 frames allow", ["HEAD-6"],
               levels=[0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 5, 5], sizes=[3])
    yield made("one-entry-codebooks", "codebooks of one entry: indices of no bits", ["DEC-1"],
               {"sh": codebook(stages=3, sizes=[1])}, {name: codebook(stages=1, sizes=[1]) for name in sb.COMPONENTS})
    yield made("one-entry-rans", "the same in rANS pages, which code such indices too", ["DEC-1"],
               {"sh": codebook(stages=3, sizes=[1])}, {name: codebook(stages=1, sizes=[1]) for name in sb.COMPONENTS},
               forms="rans")
    for bits in (1, 21):
        for form in ("streams", "rans"):
            yield made(f"fixed-{bits}-{form}", f"fixed positions of {bits} bits", ["CODE-5", "RANS-8"], {
                "position": FIXED, "position_bits": bits, "position_scale": 2.0 ** (3 - bits)}, forms=form)
    yield made("stages-8", "eight stages of all components, in rANS pages", ["CODE-3"],
               {"sh": codebook(stages=8, escapes=True)}, {name: codebook(stages=8) for name in sb.COMPONENTS},
               forms="rans", levels=[0, 2])
    yield made("opacity-16-bits", "codes of 16 bits and of 1 bit", ["CODE-1"], {
        "opacity": {"coding": 2, "bits": 16, "offset": -2.0 ** -60, "step": 2.0 ** -16}}, {
            "scale_factor": {"coding": 2, "bits": 1, "offset": 0.0, "step": -1.0}})
    yield made("extreme-positions", "the largest and the smallest frame", ["HEAD-3", "DEC-1"], {
        "position_center": {"x": 2.0 ** 60, "y": -2.0 ** 60, "z": 2.0 ** -60}, "position_scale": 2.0 ** 60})
    yield made("small-positions", "positions near the smallest binary32", ["HEAD-3", "DEC-1"],
               {"position_scale": 2.0 ** -60})
    yield made("extreme-rotors", "rotors of binary32 up to 3 * 10^38, and of zeros", ["VAL-3"], {}, {
        "rotor_spatial": {"coding": RAW32}, "rotor_temporal": {"coding": RAW32}}, levels=[0, 0, 1])
    yield made("extreme-transforms", "coefficients of -32768 and 32767 in the largest steps",
               ["TRAN-2", "DEC-1"], {
        "sh": lambda r, dim: {**transform(r, dim), "steps": [1024.0] * dim, "eob_table": [1, dim],
                              "basis": [[65504.0] * dim] * (dim + 1)}, "sh_degree": 0})
    yield made("junk", "bytes that nothing refers to, and the scene header at the end", ["CHNK-4"],
               build={"header_last": True})
    yield made("minor-version", "version 1.255, unknown fields, unknown flags and extensions",
               ["VER-1", "VER-2", "HEAD-8"], {
                   "extensions": [{"id": 0xF0000001, "critical": False}] * 3, "coordinate_system": 200,
                   "color_space": 201, "metadata": [{"key": "", "value": ""}, {"key": "\U0001F600",
                                                                           "value": "\u00e4" * 300}]},
               build={"version": (1, 255), "flags": 0xFB, "unknown_fields": True, "header_last": True})
    yield made("zstd-everywhere", "frames of raw, RLE and compressed blocks, with and without checksums",
               ["CHNK-5"], {"sh": codebook(stages=2, escapes=True), "sh_degree": 2},
               {name: codebook() for name in sb.COMPONENTS}, zstd=1, levels=[0, 1, 2, 3])
    yield made("deltas-at-the-border", "deltas that pass 2^width", ["STRM-5"], {"position": RAW32},
               {"mean_t": RAW32}, levels=[0, 0, 0])
    yield made("gate", "a gate below 16, which concerns nothing that decodes", ["HEAD-9"], {"gate": 0.5})
    yield made("stated-colours", "errors of colours that the encoder states, and a bound", ["HEAD-18"],
               {"errors": {"position": 0.5, "colors": True, "base_color": 0.25, "directional_color": 1.5,
                           "base_color_bound": 0.25}})


def by_hand():
    """(name, about, file, clauses, how it is made) of streams that chance does not make"""
    made_by = "corners.py, field by field"
    yield ("zstd-repeated-tables", "a frame whose second block has the Huffman code and the tables of the first",
           bl.stream([bl.layer([{**bl.page(96), "raw": repeated_tables() + bl.zeros(2)}])]), ["CHNK-5"], made_by)
    mean = lambda seconds: constant(order(seconds), 16)
    pages = [bl.page(1, mean(-1000.0), bucket=0, visible_begin=0, visible_end=0),
             bl.page(1, mean(-1000.0), bucket=0, visible_begin=255, visible_end=255),
             bl.page(1, mean(0.0), bucket=1),
             bl.page(1, mean(1000.0), bucket=3, visible_begin=255, visible_end=255)]
    yield ("pages-never-needed", "pages that are visible before and after the sequence alone",
           bl.stream([bl.layer(pages, 1)]), ["LAYR-2"], made_by)


def repeated_tables():
    """The x coordinates of 96 Gaussians: a frame with their low bytes, and high bytes."""
    text = bytes(b"LayersOfBuckets"[k * k % 15] for k in range(45))
    literals = frames.huffman_section(bl.FIRST, text)
    # The section's head has 3 bytes, and the table a byte and half a byte for each weight.
    codes = literals[3 + 1 + (literals[3] - 127 + 1) // 2:]
    again = (3 | len(text) << 4 | len(codes) << 14).to_bytes(3, "little") + codes
    # One sequence: a literal, and 3 bytes from one byte before.
    sequence, extra = bytes([0b01010100, 1, 2, 0]), frames.bits_of([(0, 2)])
    blocks = [literals + b"\x01" + sequence + extra, again + b"\x01" + b"\xfc" + extra]
    frame = frames.MAGIC + b"\x00\x58" + frames.block(2, blocks[0]) + frames.block(2, blocks[1], last=True)
    return b"\x01\x01" + sb.vlq(len(frame)) + frame + b"\x00" + b"\xbc" * 96


NTSC = {"num_frames": 32, "fps_num": 24000, "fps_den": 1001, "time_begin": 12.34}

BEFORE_THE_END = NTSC["time_begin"] + NTSC["num_frames"] * NTSC["fps_den"] / NTSC["fps_num"] - 1e-9


def times_of_frames():
    """Borders of buckets, as binary64: rounding has put them a little before or after the frame."""
    for k in range(2, 32, 2):
        t = NTSC["time_begin"] + k * NTSC["fps_den"] / NTSC["fps_num"]
        if (t - NTSC["time_begin"]) * NTSC["fps_num"] / NTSC["fps_den"] < k:
            yield t

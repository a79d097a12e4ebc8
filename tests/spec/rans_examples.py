#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The worked examples and test values of rANS: appendix G of spec/l4d.md, channel.l4d and transform.l4d.

  rans_examples.py --write    writes the streams, and what the appendix shows of them
"""

import struct
import sys

import generator_path           # its import makes the following ones possible
import stream_builder as sb
import decode_tiny
import rans_writer
from arithmetic import unzigzag
from broken_streams import FIRST
from file import Chunk
from rans import RansPage, Table, wide
from reconstruct import integers_of
from rans_writer import LANES, SLOTS, Channel, hybrid_token, wide_token
from streams import Streams
from xxh3 import xxh3_64

SPEC = sb.ROOT / "spec" / "l4d.md"
FOLDER = sb.ROOT / "spec" / "examples"
NO_BOUNDS = (0xFBFF,) * 3 + (0x7BFF,) * 3
LENGTHS = (1, 31, 32, 33, 64, 1000)
# The channel of appendix G.2.
INTEGERS = [0, 0, 1, 0, 3, 0, 0, 21, 0, 2, 0, 0, 0, 1, 0, 900, 0, 0, 0, 1, 0, 0, 5, 0, 0, 0, 1, 0, 0,
            40000, 0, 2, 1, 17]


def zigzag(q):
    return 2 * q if q >= 0 else -2 * q - 1


# ---- G.1: tokens and blocks ----------------------------------------------------------------------

def uniform(tokens):
    """Frequencies as equal as they can be; the first tokens have one more."""
    return [SLOTS // tokens + (t < SLOTS % tokens) for t in range(tokens)]


def test_integers(kind, n):
    if kind == "hybrid":
        return [i * 40503 % 65536 >> i % 13 for i in range(n)]
    return [(i * 0x9E3779B97F4A7C15 % 2 ** 64) >> 1 + i % 63 for i in range(n)]


def test_block(kind, n):
    wide = kind == "wide"
    channel = Channel(kind, test_integers(kind, n), wide=wide)
    return rans_writer.block([channel], [[uniform(126 if wide else 112)]])


def tokens():
    lines = ["| integer | hybrid: token, raw bits | wide: token, pieces of raw bits |", "|---|---|---|"]
    def show(token, pieces):
        return f"{token}" + "".join(f", {raw} of {bits} bits" for bits, raw in pieces)
    for v in (0, 1, 2, 3, 15, 16, 17, 18, 31, 32, 1000, 65535, 65536, 2 ** 33 - 1, 2 ** 63 - 1):
        hybrid = show(*hybrid_token(v)) if v < 1 << 16 else "-"
        lines.append(f"| {v} | {hybrid} | {show(*wide_token(v))} |")
    return lines


def blocks():
    lines = ["| kind | integers | bytes | XXH3-64 of the block |", "|---|---|---|---|"]
    for kind in ("hybrid", "wide"):
        for n in LENGTHS:
            raw = test_block(kind, n)
            lines.append(f"| {kind} | {n} | {len(raw)} | `{xxh3_64(raw):016x}` |")
    return lines


# ---- the streams ---------------------------------------------------------------------------------

ZERO = {"coding": 0}
CONSTANT = {"coding": 0, "bits": 0, "offset": -3.0, "step": 0.0}


def stream(channels, tables, maps, n, scene, layer, sh_base=0):
    """A stream of one permanent layer with one rANS page. tables: the wide one first."""
    chunk = rans_writer.entropy_chunk(tables, 1, maps)
    used = [[tables[t] for t in of_channel] for of_channel in maps]
    split = rans_writer.first_detail(channels, sh_base) if scene["sh"] != ZERO else None
    raw, detail = rans_writer.page(channels, used, split)
    page = {"num_gaussians": n, "bucket": 0, "block": sb.NO_BLOCK, "visible_begin": 0,
            "visible_end": 255, "bounds": NO_BOUNDS, "reserved": 0, "codec": 2, "raw": raw,
            "detail": detail}
    layer = {"level": 0, "permanent": True, "mean_t": 0, "num_gaussians": n, "log_scale_t": 0.0,
             "directory_bits": 0, "table_size": 1, "blocks": {}, "scale_factor": CONSTANT,
             "entropy": chunk, "pages": [page], **layer}
    scene = {"num_gaussians": n, "time_begin": 0.0, "num_frames": 1, "fps_num": 1, "fps_den": 1,
             "origin": {}, "position": 3, "position_center": {}, "sh_degree": 0, "sh_base": sh_base,
             "layers": [layer], **scene}
    return sb.build(scene, rng=FIRST)


def channel_tables():
    counts = [0] * 112
    for v in INTEGERS:
        counts[hybrid_token(v)[0]] += 1
    return [[SLOTS], rans_writer.fitted(counts)]


def channel_stream():
    """One page whose only integers that are not 0 are opacities."""
    n = len(INTEGERS)
    channels = [Channel("position", [0] * n, wide=True), Channel("opacity", INTEGERS)]
    return stream(channels, channel_tables(), [[0], [1]], n,
                  {"position_bits": 1, "position_scale": 1.0, "sh": ZERO,
                   "opacity": {"coding": 2, "bits": 16, "offset": 0.0, "step": 2.0 ** -16}},
                  {"scale": ZERO, "rotor_spatial": ZERO, "rotor_temporal": ZERO})


def transform(steps, eob_table, *basis):
    return {"coding": 3, "steps": steps, "eob_table": eob_table, "basis": list(basis)}


CODES = [0x015, 0x0A3, 0x7F0]                             # Morton codes
SCALE_STEP_EXPONENT, ROTOR_STEP_EXPONENT, SH_STEP_EXPONENT = [0, 1, 1], [2, 2, 0], [1, 1, 2]
SCALE = [[2, -1, 6], [0, 3, -20]]                         # coefficient by coefficient
ROTOR = [[1, -4, 0]]
EOB_INDICES = [2, 0, 1]
SH = [[5, -1], [-9], [1]]                                 # of the Gaussians that have one
SCENE = {"position_bits": 4, "position_scale": 0.25, "sh_degree": 0,
         "opacity": {"coding": 2, "bits": 4, "offset": 0.0625, "step": 0.0625},
         "sh": transform([0.5, 0.25, 0.125], [1, 3], (0.25, 0.0, -0.25), (1.0, 1.0, 1.0),
                         (1.0, 0.0, -1.0), (-0.5, 1.0, -0.5))}
LAYER = {"scale": transform([0.5, 0.25], [2], (0.0, 0.0, -1.0), (1.0, 1.0, 0.0), (1.0, -1.0, 0.5)),
         "rotor_spatial": transform([0.25], [1], (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
         "rotor_temporal": ZERO}


def transform_channels():
    """The channels, with the contexts that section 13.2 says."""
    gaps = [b - a for a, b in zip([0, *CODES], CODES)]
    def coefficients(name, step_exponents, columns, who):
        out, before = [], [[] for _ in step_exponents]
        for k, column in enumerate(columns):
            contexts = []
            for i, q in zip(who[k], column):
                a = sum(map(abs, before[i][-2:]))
                m = sum(a >= limit for limit in (1, 3, 7, 15))
                contexts.append(step_exponents[i] if k == 0 else 5 * step_exponents[i] + m)
                before[i].append(q)
            out.append(Channel(f"{name} coefficient {k}", list(map(zigzag, column)), contexts,
                             80 if k else 16))
        return out
    everyone = [range(3)] * 2
    return [Channel("position", gaps, wide=True), Channel("opacity", [15, 8, 4]),
            Channel("scale step exponent", SCALE_STEP_EXPONENT, [0] * 3, 16),
            *coefficients("scale", SCALE_STEP_EXPONENT, SCALE, everyone),
            Channel("rotor_spatial step exponent", ROTOR_STEP_EXPONENT, SCALE_STEP_EXPONENT, 16),
            *coefficients("rotor_spatial", ROTOR_STEP_EXPONENT, ROTOR, everyone),
            Channel("sh step exponent", SH_STEP_EXPONENT, ROTOR_STEP_EXPONENT, 16),
            Channel("sh EOB index", EOB_INDICES, SH_STEP_EXPONENT, 16),
            *coefficients("sh", SH_STEP_EXPONENT, SH, [[0, 2], [0], [0]])]


def transform_stream():
    """Three Gaussians in one page of two chunks. Table 1 codes small integers, table 2 coefficients of
    small neighbours, table 3 those of large ones."""
    channels, maps = transform_channels(), []
    counts = [[0] * 126] + [[0] * 112 for _ in range(3)]
    for p in channels:
        last = p.name.split()[-2:-1] == ["coefficient"]
        maps.append([0 if p.wide else 1 if not last else 2 if p.num_contexts == 16 else
                     2 + (c % 5 > 1) for c in range(p.num_contexts)])
        for (token, _), context in zip(p.tokens, p.contexts):
            counts[maps[-1][context]][token] += 1
    return stream(channels, [rans_writer.fitted(c) for c in counts], maps, 3, SCENE, LAYER, sh_base=1)


# ---- what the appendix shows ---------------------------------------------------------------------

def hex_rows(raw, at, indent="  "):
    return [f"{indent}{at + i:04x}  {raw[i:i + 16].hex(' ')}" for i in range(0, len(raw), 16)]


def table_text(frequencies):
    return ", ".join(f"{t}: {f}" for t, f in enumerate(frequencies) if f)


class Traced:
    """Decodes a hybrid channel and says each step."""

    def __init__(self, raw):
        self.words = struct.unpack_from(f"<{(len(raw) - 128) // 2}H", raw, 128)
        self.states = list(struct.unpack_from(f"<{LANES}I", raw))
        self.used, self.lines, self.values = 0, [], []

    def refill(self, lane):
        if self.states[lane] >= 1 << 16:
            return ""
        word = self.words[self.used]
        self.used += 1
        self.states[lane] = (self.states[lane] << 16) + word
        return f"  word {word:04x} -> {self.states[lane]:08x}"

    def token(self, i, frequencies):
        lane = i % LANES
        x = self.states[lane]
        slot = x & 1023
        token = next(t for t in range(112) if sum(frequencies[:t + 1]) > slot)
        f, c = frequencies[token], sum(frequencies[:token])
        self.states[lane] = f * (x >> 10) + slot - c
        text = (f"{i:2}  lane {lane:2}  x {x:08x}  slot {slot:4}  token {token:3}  c {c:4}  f {f:4}"
                f"  x {self.states[lane]:08x}")
        self.lines.append(text + self.refill(lane))
        return token

    def raw(self, i, bits):
        lane = i % LANES
        x = self.states[lane]
        value = x & (1 << bits) - 1
        self.states[lane] = x >> bits
        text = f"{i:2}  lane {lane:2}  x {x:08x}  {bits} bits: raw {value}  x {self.states[lane]:08x}"
        self.lines.append(text + self.refill(lane))
        return value

    def channel(self, n, frequencies):
        for group in range(0, n, LANES):
            members = range(group, min(group + LANES, n))
            self.lines.append(f"group {group // LANES}: tokens")
            found = [self.token(i, frequencies) for i in members]
            values = found[:]
            if any(t >= 16 for t in found):
                self.lines.append(f"group {group // LANES}: raw bits")
            for place, (i, t) in enumerate(zip(members, found)):
                if t >= 16:
                    e = t - 16 >> 3
                    values[place] = (8 + (t - 16 & 7) << e + 1) + self.raw(i, e + 1)
            self.values += values


def chunk_of(data, kind):
    """(offset, bytes) of the entropy chunk, the page or its SH chunk of the stream's one layer."""
    file, _ = decode_tiny.decode(data)
    decoder = decode_tiny.Decoder(file)
    if kind == "entropy":
        ref = decoder.header["layers"][0]["entropy"]
        return int(ref["offset"]), data[ref["offset"]:][:ref["stored_bytes"]]
    record = next(iter(decoder.select(decode_tiny.Query()))).record
    offset, size = (("offset", "stored_bytes") if kind == "page" else ("sh_offset", "sh_bytes"))
    at = int(decoder.header["payload_offset"] + record[offset])
    return at, data[at:][:record[size]]


def channel_example():
    at, raw = chunk_of(channel_stream(), "page")
    frequencies = channel_tables()[1]
    traced = Traced(raw)
    traced.channel(len(INTEGERS), frequencies)
    assert traced.values == INTEGERS and traced.used == len(traced.words)
    assert traced.states == [1 << 16] * LANES
    return ["```", f"table   {table_text(frequencies)}", "states", *hex_rows(raw[:128], at), "words",
            *hex_rows(raw[128:], at + 128), *traced.lines, "integers",
            *["  " + " ".join(map(str, INTEGERS[i:i + 17])) for i in (0, 17)], "```"]


def recorded(data):
    """(name, contexts, integers) of the channels as the reference reads them."""
    out, read = [], RansPage.read

    def reading(self, n, width, what, limit=0, limit_clause="", contexts=None):
        values = read(self, n, width, what, limit, limit_clause, contexts)
        out.append((what, contexts or [0] * n, values))
        return values
    RansPage.read = reading
    try:
        _, gaussians = decode_tiny.decode(data)
    finally:
        RansPage.read = read
    return out, gaussians


def run_lengths(numbers):
    out, i = [], 0
    while i < len(numbers):
        n = 1
        while i + n < len(numbers) and numbers[i + n] == numbers[i]:
            n += 1
        out.append(f"{numbers[i]:02x}" + f" x {n}" * (n > 1))
        i += n
    return ", ".join(out)


def entropy_lines(data, channels):
    at, raw = chunk_of(data, "entropy")
    file = decode_tiny.File(data)
    streams = Streams(file, Chunk(raw, at))
    num_tables, num_wide = streams.vlq(), streams.vlq()
    lines = [f"  {raw[:2].hex(' ')}  num_tables = {num_tables}, num_wide = {num_wide}"]
    for t in range(num_tables):
        begin = streams.at
        table = Table(streams, wide, 126)
        shown = [0] * 126
        for token, _, frequency in table.slots:
            shown[token] = frequency
        lines += [f"  {raw[begin:streams.at].hex(' ')}", f"      table {t}: {table_text(shown)}"]
    for p in channels:
        used = streams.take(p.num_contexts)
        text = run_lengths(used)
        if p.num_contexts == 80:          # 5 for each class
            assert used == used[:5] * 16
            text = f"({run_lengths(used[:5])}) x 16"
        lines.append(f"  map of {p.name}: {text}")
    streams.end()
    return [f"entropy chunk, {len(raw)} bytes", *lines]


def block_lines(title, data, kind):
    at, raw = chunk_of(data, kind)
    words = ["  words", *hex_rows(raw[128:], at + 128, "    ")] if raw[128:] else ["  no words"]
    return [f"{title}, {len(raw)} bytes", "  states", *hex_rows(raw[:128], at, "    "), *words]


def vector(v):
    return "(" + ", ".join(f"{x:g}" for x in v) + ")"


def row_text(coding, of_class, q):
    """The row of a transform as section 14 has it, and its numbers."""
    row, text = list(coding["basis"][0]), vector(coding["basis"][0])
    for value, step, axis in zip(q, coding["steps"], coding["basis"][1:]):
        row = [r + value * 2.0 ** -of_class * step * a for r, a in zip(row, axis)]
        text += f" + {value} * 2^-{of_class} * {step:g} * {vector(axis)}"
    return f"{text} = {vector(row)}", row


def integer_row_text(coding, of_class, q):
    """The lines of a row of SH, and its numbers."""
    origin, *axes = coding["basis"]
    m, e = integers_of(coding["steps"], axes)
    total = [sum(value * vector[d] for value, vector in zip(q, m)) for d in range(len(origin))]
    row = [a + t * 2.0 ** (e - of_class) for a, t in zip(origin, total)]
    terms = " + ".join(f"{value} * {vector(v)}" for value, v in zip(q, m))
    return [f"E = {e + 15}, " + ", ".join(f"m[{k}] = {vector(v)}" for k, v in enumerate(m)),
            f"t = {terms} = {vector(total)}",
            f"{vector(origin)} + t * 2^{e - of_class} = {vector(row)}"], row


def by_hand(gaussians):
    """Two rows, worked out."""
    scale, scale_row = row_text(LAYER["scale"], SCALE_STEP_EXPONENT[2], [SCALE[0][2], SCALE[1][2]])
    sh, sh_row = integer_row_text(SCENE["sh"], SH_STEP_EXPONENT[0], [column[0] for column in SH])
    assert [x + CONSTANT["offset"] for x in scale_row] == list(gaussians[2]["log_scale"][:3])
    assert sh_row == list(gaussians[0]["sh"])
    x, y, z = (sum((CODES[2] >> 3 * b + j & 1) << b for b in range(4)) for j in range(3))
    assert [v * SCENE["position_scale"] for v in (x, y, z)] == list(gaussians[2]["position"])
    gaps = " + ".join(f"{b - a:x}" for a, b in zip([0, *CODES], CODES))
    return [f"Gaussian 2  Morton code  {gaps} = {CODES[2]:x} hexadecimal: {x} {y} {z}, times 0.25",
            f"Gaussian 2  scale  {scale}",
            f"Gaussian 2  log_scale  -3 + scale = {vector(gaussians[2]['log_scale'][:3])}",
            *(f"Gaussian 0  sh  {line}" for line in sh)]


def transform_example():
    data = transform_stream()
    channels, (read, gaussians) = transform_channels(), recorded(data)
    assert [(p.name, p.contexts, p.values) for p in channels] == read
    lines = ["```", *entropy_lines(data, channels), *block_lines("base chunk", data, "page"),
             *block_lines("SH chunk", data, "detail"), "channels"]
    for name, contexts, values in read:
        text = f"  {name:<27} {' '.join(map(str, values)):<13} contexts {' '.join(map(str, contexts)):<9}"
        if "coefficient" in name:
            text += f" q {' '.join(str(unzigzag(z)) for z in values)}"
        lines.append(text.rstrip())
    return [*lines, "", *by_hand(gaussians), "", *decode_tiny.decimals(gaussians), "```"]


PARTS = {"tokens": tokens, "blocks": blocks, "channel": channel_example, "transform": transform_example}
STREAMS = {"channel.l4d": channel_stream, "transform.l4d": transform_stream}


def markers(name):
    return f"<!-- {name}: written by tests/spec/rans_examples.py -->\n", f"<!-- end of {name} -->"


def shown(text, name):
    """(begin, end) of what the document shows of a part."""
    begin, end = markers(name)
    return text.index(begin) + len(begin), text.index(end)


def write():
    for name, make in STREAMS.items():
        (FOLDER / name).write_bytes(make())
    text = SPEC.read_text(encoding="utf-8")
    for name, make in PARTS.items():
        begin, end = shown(text, name)
        text = text[:begin] + "\n".join(make()) + "\n" + text[end:]
    SPEC.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    if sys.argv[1:] != ["--write"]:
        sys.exit(__doc__)
    write()

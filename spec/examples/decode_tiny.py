#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Reads an .l4d file as spec/l4d.md says and explains every byte of it.

Written from the specification alone and in its order, for reading and not for speed: integers and
correctly rounded binary32 steps in plain Python. It decodes any file whose chunks and byte planes
are stored; undoing zstd is left to others.

  decode_tiny.py [FILE]            the bytes, annotated, then the decoded Gaussians
  decode_tiny.py --values [FILE]   every decoded value as the bits of its binary32
"""

import math
import struct
import sys
from pathlib import Path

from flatbuffer import FlatBuffer, Invalid, Schema
from xxh3 import xxh3_64

HERE = Path(__file__).resolve().parent
MAGIC = bytes.fromhex("894c34440d0a1a0a")
SH, SCALE, ROTOR_SPATIAL, ROTOR_TEMPORAL = range(4)
COMPONENTS = ("sh", "scale", "rotor_spatial", "rotor_temporal")
CONSTANT, RAW32, SQ = range(3)      # scalar-coding
ZERO, _, VQ = range(3)              # component-coding; 1 is RAW32
NONE, _, F16 = range(3)             # mean-coding; 1 is RAW32
LITERAL = 15
NO_BLOCK = 0xFFFFFFFF


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


# ---- the file ------------------------------------------------------------------------------------

class File:
    def __init__(self, data):
        self.data = data
        self.claims = []                  # (begin, end, text)
        self.schema = Schema(HERE.parent / "l4d.fbs")

    def claim(self, begin, end, text):
        self.claims.append((begin, end, text))

    def bytes(self, offset, n):
        require(offset + n <= len(self.data), "CHNK-1", f"bytes {offset}..{offset + n}")
        return self.data[offset:offset + n]

    def chunk(self, ref, most, base=0):
        """The raw bytes of a chunk and where they lie."""
        at = base + ref["offset"]
        require(at < 1 << 64, "CHNK-1", f"offset {at}")
        stored = self.bytes(at, ref["stored_bytes"])
        require(xxh3_64(stored) == ref["hash"], "CHNK-2", f"hash of the chunk at {at}")
        require(ref["codec"] <= 1, "CHNK-6", f"codec {ref['codec']}")
        if ref["codec"] == 1:
            raise NotImplementedError("zstd")
        require(ref["raw_bytes"] <= most, "CHNK-8", f"{ref['raw_bytes']} raw bytes")
        require(ref["stored_bytes"] == ref["raw_bytes"], "CHNK-3", "sizes of a stored chunk")
        return stored, at

    def flatbuffer(self, data, at, name, identifier, clause):
        def claim(begin, end, text):
            self.claim(at + begin, at + end, text)
        return FlatBuffer(self.schema, data, clause, claim).root(name, identifier)

    def file_header(self):
        d = self.data
        require(d[:8] == MAGIC[:len(d[:8])] and len(d) >= 40, "FILE-1", "magic")
        major, minor, flags, header_bytes, offset, header_hash, own_hash = struct.unpack_from(
            "<BBHIQQQ", d, 8)
        require(own_hash == xxh3_64(d[:32]), "FILE-4", "hash of the file header")
        require(major == 1, "FILE-2", f"version {major}.{minor}")
        require(flags & 0xFF00 == 0, "FILE-3", f"flags {flags:04x}")
        require(offset >= 40 and header_bytes > 0, "FILE-5", "place of the scene header")
        for begin, end, text in (
                (0, 8, "magic"), (8, 9, f"version_major = {major}"),
                (9, 10, f"version_minor = {minor}"),
                (10, 12, f"flags = 0x{flags:04x}" + ": development" * (flags & 1)),
                (12, 16, f"header_bytes = {header_bytes}"), (16, 24, f"header_offset = {offset}"),
                (24, 32, "header_hash: XXH3-64 of the scene header"),
                (32, 40, "file_header_hash: XXH3-64 of bytes 0 to 31")):
            self.claim(begin, end, text)
        raw = self.bytes(offset, header_bytes)
        require(xxh3_64(raw) == header_hash, "FILE-6", "hash of the scene header")
        return raw, offset


# ---- streams -------------------------------------------------------------------------------------

class Streams:
    """The streams of one chunk, front to back."""

    def __init__(self, file, raw, base):
        self.file, self.raw, self.base, self.at = file, raw, base, 0

    def take(self, n):
        require(self.at + n <= len(self.raw), "STRM-2", f"stream at {self.base + self.at}")
        self.at += n
        return self.raw[self.at - n:self.at]

    def vlq(self):
        value = 0
        for shift in range(0, 63, 7):
            b = self.take(1)[0]
            value |= (b & 0x7F) << shift
            if b < 0x80:
                return value
        raise Invalid("STRM-2", "vlq of more than 9 bytes")

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

    def read(self, n, width, what, limit=0, limit_clause=""):
        """n values of `width` bits, all below `limit` where that is not 0."""
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

    def halves(self, n, what, clause):
        bits = [unorder(v, 16) for v in self.read(n, 16, what)]
        require(all(b & 0x7FFF < 0x7C00 for b in bits), clause, f"{what} is not finite")
        return [half(b) for b in bits]

    def floats(self, n, what):
        bits = [unorder(v, 32) for v in self.read(n, 32, what)]
        require(all(b & 0x7FFFFFFF < 0x7F800000 for b in bits), "VAL-3", f"{what} is not finite")
        return [f32_of_bits(b) for b in bits]

    def end(self, clause):
        require(self.at == len(self.raw), clause, "bytes left over")


# ---- the scene header ----------------------------------------------------------------------------

def check_header(h, header_bytes):
    require(1 <= h["num_frames"] <= 1 << 24 and h["fps_num"] and h["fps_den"], "HEAD-2", "timeline")
    require(all(map(sound, [h["time_begin"], *h["position_center"].values()])) and
            sound(h["position_scale"]) and h["position_scale"] > 0 and
            all(map(math.isfinite, [h["world_scale"], *h["origin"].values()])), "HEAD-3", "range")
    require(0 < h["gate"] <= 16, "HEAD-9", "gate")
    require(h["sh_degree"] <= 3, "HEAD-4", "sh_degree")
    require(h["position"] in (RAW32, F16), "HEAD-7", "position")
    check_scalar(h["opacity"])
    check_component(h["sh"], rcq=False)
    levels = bit_width(h["num_frames"]) + 1
    require(1 <= len(h["layers"]) <= 2 * levels, "HEAD-6", "number of layers")
    level = 0
    for layer in h["layers"]:
        require(level <= layer["level"] < levels, "HEAD-6", "level")
        level = layer["level"]
        require(layer["mean_t"] <= F16, "HEAD-7", "mean_t")
        require(layer["permanent"] == (layer["mean_t"] == NONE) and
                not (layer["permanent"] and level), "HEAD-10", "permanent layer")
        require(sound(layer["log_scale_t"]), "HEAD-3", "log_scale_t")
        check_scalar(layer["scale_factor"])
        require(layer["scale_factor"]["coding"] != RAW32, "HEAD-14", "raw scale_factor")
        for name in COMPONENTS[1:]:
            check_component(layer[name], rcq=level > 0)
        require(layer["rotor_temporal"]["coding"] != RAW32 or
                layer["rotor_spatial"]["coding"] == RAW32, "HEAD-11", "raw temporal rotor")
        require(layer["directory_bits"] <= 16 and
                directory_pages(level, int(layer["directory_bits"])) <= 1 << 20,
                "HEAD-12", "directory_bits")
    total = sum(layer["num_gaussians"] for layer in h["layers"])
    require(total == h["num_gaussians"], "HEAD-5", "sum of num_gaussians")
    require(not any(e["critical"] for e in h["extensions"] or ()), "HEAD-8", "extension")
    texts = [m[key] for m in h["metadata"] or () for key in ("key", "value")]
    require(sum(len(t.encode("utf-8")) for t in texts) <= header_bytes, "HEAD-13", "metadata")


def check_scalar(s):
    require(s["coding"] <= SQ, "HEAD-7", "scalar coding")
    require(sound(s["offset"]) and sound(s["step"]), "HEAD-3", "offset or step")
    require(s["coding"] != SQ or 1 <= s["bits"] <= 16, "CODE-1", "bits")


def check_component(c, rcq):
    require(c["coding"] <= VQ, "HEAD-7", "component coding")
    if c["coding"] != VQ:
        return
    require(1 <= len(c["stages"] or ()) <= 8, "CODE-3", "stages")
    require(rcq or c["rcq"] is None, "RCQ-2", "RCQ")
    stages = [(s, 65536) for s in c["stages"]]
    for stage, most in stages if c["rcq"] is None else [*stages, (c["rcq"], 4096)]:
        require(1 <= stage["num_entries"] <= most, "CODE-2", "entries")
        require(stage["element"] == 0, "HEAD-7", "element")


def num_buckets(level):
    return 1 if level == 0 else 1 << (level + 1)


def directory_pages(level, directory_bits):
    return -(-num_buckets(level) // (1 << directory_bits))


# ---- decoding ------------------------------------------------------------------------------------

class Decoder:
    def __init__(self, file):
        self.file = file
        raw, at = file.file_header()
        self.header = h = file.flatbuffer(raw, at, "Header", b"L4DH", "HEAD-1")
        check_header(h, len(raw))
        self.duration = h["num_frames"] * float(h["fps_den"]) / h["fps_num"]
        self.books = {}

    def component(self, layer, c):
        return self.header["sh"] if c == SH else self.header["layers"][layer][COMPONENTS[c]]

    def dim(self, layer, c):
        if c == SH:
            return 3 * (int(self.header["sh_degree"]) + 1) ** 2
        return 3 if c == SCALE and self.header["layers"][layer]["permanent"] else 4

    def book(self, layer, c, stage):
        """Rows of a codebook; stage 8 is the residual codebook."""
        key = (0 if c == SH else layer, c, stage)
        if key not in self.books:
            coding = self.component(layer, c)
            s = coding["rcq"] if stage == 8 else coding["stages"][stage]
            name = f"{COMPONENTS[c]} codebook" + f" {stage}" * (len(coding["stages"]) > 1)
            name = name if c == SH else f"layer {layer} {name}"
            most = self.dim(layer, c) * (2 * s["num_entries"] + 32)
            streams = Streams(self.file, *self.file.chunk(s["codebook"], most))
            columns = [streams.halves(s["num_entries"], f"{name}, number {d}", "CODE-4")
                       for d in range(self.dim(layer, c))]
            streams.end("CHNK-7")
            self.books[key] = list(zip(*columns))
        return self.books[key]

    def block_books(self, layer, block):
        """Component -> rows of the block codebook."""
        books = {}
        for table in block["tables"]:
            c, n = table["component"], table["num_entries"]
            require(c in (1, 2, 3) and self.component(layer, c)["rcq"] is not None,
                    "RCQ-3", f"component {c}")
            require(1 <= n <= 65536, "RCQ-4", "entries")
            require(c not in books, "RCQ-5", "two tables")
            whole, residual = self.book(layer, c, 0), self.book(layer, c, 8)
            streams = Streams(self.file, *self.file.chunk(
                table["table"], 2 * (2 * n + 32), self.header["payload_offset"]))
            g = streams.read(n, bit_width(len(whole)), "global", len(whole), "RCQ-1")
            r = streams.read(n, bit_width(len(residual)), "residual", len(residual), "RCQ-1")
            streams.end("CHNK-7")
            books[c] = [[f32(a + b) for a, b in zip(whole[i], residual[j])] for i, j in zip(g, r)]
        return books

    def gaussians(self):
        for index, layer in enumerate(self.header["layers"]):
            if layer["num_gaussians"] > 0:
                yield from self.layer(index, layer)

    def layer(self, index, layer):
        bits = int(layer["directory_bits"])
        buckets = num_buckets(layer["level"])
        count = 0
        for d in range(directory_pages(layer["level"], bits)):
            page = self.directory_page(index, layer, d)
            if page is None:
                continue
            require(len(page["blocks"] or ()) <= 256, "DIR-11", "blocks")
            blocks = [self.block_books(index, b) for b in page["blocks"] or ()]
            previous = None
            for r in page["pages"]:
                require(r["bucket"] >> bits == d and r["bucket"] < buckets and
                        (previous is None or r["bucket"] >= previous["bucket"]), "DIR-3", "bucket")
                require(1 <= r["num_gaussians"] <= 65536, "DIR-4", "num_gaussians")
                require(r["block"] == NO_BLOCK or r["block"] < len(blocks), "DIR-6", "block")
                require(previous is None or previous["bucket"] != r["bucket"] or
                        previous["block"] == r["block"], "DIR-8", "blocks of a bucket")
                require(r["visible_begin"] <= r["visible_end"], "DIR-7", "visible interval")
                box = [half(b) for b in r["bounds"]]
                require(all(map(math.isfinite, box)) and
                        all(a <= b for a, b in zip(box, box[3:])), "DIR-12", "bounds")
                previous = r
                count += r["num_gaussians"]
                block = {} if r["block"] == NO_BLOCK else blocks[r["block"]]
                yield from self.page(index, layer, r, block)
        require(count == layer["num_gaussians"], "DIR-5", "Gaussians of a layer")

    def directory_page(self, index, layer, d):
        at = layer["page_table_offset"] + 32 * d
        entry = self.file.bytes(at, 32)
        keys = ("offset", "hash", "stored_bytes", "raw_bytes", "codec")
        values = struct.unpack("<QQIIII", entry)
        require(values[5] == xxh3_64(entry[:28]) & 0xFFFFFFFF, "DIR-1", "hash of an entry")
        name = f"page table of layer {index}, entry {d}"
        for begin, end, text in ((0, 8, f"offset = {values[0]}"), (8, 16, "hash"),
                                 (16, 20, f"stored_bytes = {values[2]}"),
                                 (20, 24, f"raw_bytes = {values[3]}"),
                                 (24, 28, f"codec = {values[4]}"),
                                 (28, 32, "entry_hash: low half of XXH3-64 of bytes 0 to 27")):
            self.file.claim(at + begin, at + end, f"{name}: {text}")
        ref = dict(zip(keys, values))
        if ref["stored_bytes"] == 0:
            return None
        raw, begin = self.file.chunk(ref, 1 << 26)
        page = self.file.flatbuffer(raw, begin, "DirectoryPage", b"L4DD", "DIR-2")
        require((page["layer"], page["index"]) == (index, d), "DIR-2", "layer or index")
        return page

    def page(self, index, layer, record, block):
        h, n = self.header, record["num_gaussians"]
        numbers = 17 + self.dim(index, SH)
        most = n * (4 * numbers + 72) + 32 * (numbers + 36)
        streams = Streams(self.file, *self.file.chunk(record, most, h["payload_offset"]))

        def scalar(coding, what):
            if coding["coding"] == CONSTANT:
                return [coding["offset"]] * n
            if coding["coding"] == RAW32:
                return streams.floats(n, what)
            return [f32(coding["offset"] + f32(coding["step"] * code))
                    for code in streams.read(n, int(coding["bits"]), what)]

        position = []
        for axis in "xyz":
            if h["position"] == RAW32:
                position.append(streams.floats(n, f"position {axis}"))
            else:
                center, scale = h["position_center"][axis], h["position_scale"]
                position.append([f32(center + f32(scale * v))
                                 for v in streams.halves(n, f"position {axis}", "VAL-1")])

        width = self.duration / num_buckets(layer["level"])
        center = h["time_begin"] + (record["bucket"] + 0.5) * width
        if layer["mean_t"] == RAW32:
            mean = streams.floats(n, "mean_t")
            local = [f32(v - center) for v in mean]
        else:
            local = [0.0] * n
            if layer["mean_t"] == F16:
                local = [f32(f32(width) * v) for v in streams.halves(n, "mean_t", "VAL-1")]
            mean = [f32(center + v) for v in local]

        opacity = scalar(h["opacity"], "opacity")
        factor = scalar(layer["scale_factor"], "scale_factor")
        rows = [self.rows(streams, index, c, n, block.get(c)) for c in range(4)]
        streams.end("PAGE-1")

        for i in range(n):
            log_scale = list(rows[SCALE][i])
            if layer["scale"]["coding"] != RAW32:
                log_scale = [f32(factor[i] + v) for v in log_scale]
            if layer["permanent"]:
                log_scale.append(layer["log_scale_t"])
            rotor = list(rows[ROTOR_SPATIAL][i]) + list(rows[ROTOR_TEMPORAL][i])
            if layer["rotor_spatial"]["coding"] != RAW32:
                rotor = normalize_rotor(rotor)
            yield {"position": [p[i] for p in position], "mean_t_local": [local[i]],
                   "mean_t": [mean[i]], "log_scale": log_scale, "rotor": rotor,
                   "opacity": [opacity[i]], "sh": list(rows[SH][i])}

    def rows(self, streams, layer, c, n, block_book):
        """Vectors of one component."""
        coding, dim, name = self.component(layer, c), self.dim(layer, c), COMPONENTS[c]
        if coding["coding"] == ZERO:
            return [[0.0] * dim] * n
        if coding["coding"] == RAW32:
            return list(zip(*[streams.floats(n, f"{name}, number {d}") for d in range(dim)]))
        stages = len(coding["stages"])
        books = [self.book(layer, c, s) for s in range(stages)]
        if block_book is not None:
            books[0] = block_book
        depth = [stages] * n
        if stages > 1 or coding["literals"]:
            depth = streams.read(n, 4, f"{name} depth")
            for d in depth:
                require(d <= stages or d == LITERAL and coding["literals"], "VQ-1", f"depth {d}")
        index = []
        for s in range(stages):
            count = sum(1 for d in depth if d != LITERAL and d > s)
            index.append(iter(streams.read(count, bit_width(len(books[s])),
                                           f"{name} index, stage {s}", len(books[s]), "VQ-2")))
        literals = sum(1 for d in depth if d == LITERAL)
        literal = zip(*[streams.halves(literals, f"{name} literal, number {d}", "VAL-2")
                        for d in range(dim)])
        rows = []
        for d in depth:
            if d == LITERAL:
                rows.append(next(literal))
                continue
            row = [0.0] * dim
            for s in range(d):
                codeword = books[s][next(index[s])]
                row = list(codeword) if s == 0 else [f32(a + b) for a, b in zip(row, codeword)]
            rows.append(row)
        return rows


def normalize_half(v):
    squares = [f32(x * x) for x in v]
    norm2 = f32(f32(squares[0] + squares[1]) + f32(squares[2] + squares[3]))
    if norm2 < f32_of_bits(0x2B8CBCCC):
        return [1.0, 0.0, 0.0, 0.0]
    r = f32(math.sqrt(norm2))
    return [f32(x / r) for x in v]


def normalize_rotor(rotor):
    s, b01, b02, b12, b03, b13, b23, p = rotor
    a = normalize_half([f32(s + p), f32(b01 - b23), f32(b02 + b13), f32(b12 - b03)])
    b = normalize_half([f32(s - p), f32(b01 + b23), f32(b02 - b13), f32(b12 + b03)])
    return [f32(f32(x) * 0.5) for x in
            (f32(a[0] + b[0]), f32(a[1] + b[1]), f32(a[2] + b[2]), f32(a[3] + b[3]),
             f32(b[3] - a[3]), f32(a[2] - b[2]), f32(b[1] - a[1]), f32(a[0] - b[0]))]


# ---- output --------------------------------------------------------------------------------------

def dump(file):
    """Lines that show every byte once, with what it means."""
    lines, at = [], 0

    def show(begin, end, text):
        for i in range(begin, end, 8):
            row = file.data[i:min(i + 8, end)].hex(" ")
            lines.append(f"{i:04x}  {row:<23}  {text if i == begin else ''}".rstrip())

    for begin, end, text in sorted(set(file.claims)):
        if begin > at:
            show(at, begin, "padding")
        require(begin >= at, "CHNK-4", f"byte {begin} read twice: {text}")
        show(begin, end, text)
        at = end
    if at < len(file.data):
        show(at, len(file.data), "not referred to")
    return lines


def values(gaussians):
    return [f"{name} {i} {k} {bits_of_f32(v):08x}"
            for i, g in enumerate(gaussians) for name, row in g.items() for k, v in enumerate(row)]


def decimals(gaussians):
    lines = []
    for i, g in enumerate(gaussians):
        for name, row in g.items():
            lines.append(f"Gaussian {i}  {name:<12}  " + "  ".join(f"{v:.9g}" for v in row))
    return lines


def decode(data):
    file = File(data)
    return file, list(Decoder(file).gaussians())


def main(arguments):
    only_values = "--values" in arguments
    paths = [a for a in arguments if not a.startswith("-")]
    try:
        file, gaussians = decode(Path(paths[0] if paths else HERE / "tiny.l4d").read_bytes())
    except (Invalid, NotImplementedError) as error:
        print(f"decode_tiny.py: {error}", file=sys.stderr)
        return 1
    print("\n".join(values(gaussians) if only_values else dump(file) + [""] + decimals(gaussians)))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

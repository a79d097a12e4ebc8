#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Reads an .l4d file as spec/l4d.md says and explains every byte of it.

Written from the specification alone and in its order, for reading and not for speed: integers and
correctly rounded binary32 steps in plain Python. It decodes any file whose chunks and byte planes
are stored; undoing zstd is left to others.

  decode_tiny.py [FILE]            the bytes, annotated, then the decoded Gaussians
  decode_tiny.py --values [FILE]   every decoded value as the bits of its binary32
  decode_tiny.py --base ..         without second parts of pages: SH is what the base holds
"""

import bisect
import math
import struct
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1] / "conformance" / "reference"))

from flatbuffer import FlatBuffer, Invalid, Schema
from header import (COMPONENTS, CONSTANT, F16, FIXED, RAW32, RAW64, ROTOR_SPATIAL, ROTOR_TEMPORAL,
                          SCALE, SH, TRANSFORM, VQ, ZERO, check_header, directory_pages,
                          num_buckets)
from rans import (MAGNITUDES, Entropy, RansPage, codable, has_fine_mean_times, page_planes,
                  vector_length)
from streams import (Streams, bit_width, bits_of_f32, f32, f32_of_bits, finite_halves, half,
                     part_of_step, require)
from xxh3 import xxh3_64

EXACT = "mean_t_double"     # the one attribute that is binary64
MAGIC = bytes.fromhex("894c34440d0a1a0a")
LITERAL = 15
NO_BLOCK = 0xFFFFFFFF
STORED, ZSTD, RANS32 = range(3)     # chunk-codec
RESIDUAL, BASIS = 8, 9              # stand for stages


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

    def chunk(self, ref, most, base=0, codecs=(STORED, ZSTD)):
        """The raw bytes of a chunk and where they lie."""
        at = base + ref["offset"]
        require(at < 1 << 64, "CHNK-1", f"offset {at}")
        stored = self.bytes(at, ref["stored_bytes"])
        require(xxh3_64(stored) == ref["hash"], "CHNK-2", f"hash of the chunk at {at}")
        require(ref["codec"] in codecs, "CHNK-6", f"codec {ref['codec']}")
        if ref["codec"] == ZSTD:
            raise NotImplementedError("zstd")
        require(ref["raw_bytes"] <= most, "CHNK-8", f"{ref['raw_bytes']} raw bytes")
        require(ref["stored_bytes"] == ref["raw_bytes"], "CHNK-3", "sizes of a chunk")
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


# ---- decoding ------------------------------------------------------------------------------------

class Decoder:
    """base: leaves out second parts of pages."""

    def __init__(self, file, base=False):
        self.file, self.base = file, base
        raw, at = file.file_header()
        self.header = h = file.flatbuffer(raw, at, "Header", b"L4DH", "HEAD-1")
        check_header(h, len(raw))
        self.duration = h["num_frames"] * float(h["fps_den"]) / h["fps_num"]
        self.books, self.entropies = {}, {}
        self.parts = []                   # (begin, end) of the chunks of pages

    def component(self, layer, c):
        return self.header["sh"] if c == SH else self.header["layers"][layer][COMPONENTS[c]]

    def dim(self, layer, c):
        return vector_length(self.header, self.header["layers"][layer], COMPONENTS[c])

    def book(self, layer, c, stage):
        """Rows of a codebook, or of a basis."""
        key = (0 if c == SH else layer, c, stage)
        if key not in self.books:
            coding = self.component(layer, c)
            s = (coding["basis"] if stage == BASIS else coding["rcq"] if stage == RESIDUAL else
                 coding["stages"][stage])
            name = f"{COMPONENTS[c]} codebook" + f" {stage}" * (len(coding["stages"] or ()) > 1)
            name = name if c == SH else f"layer {layer} {name}"
            most = self.dim(layer, c) * (2 * s["num_entries"] + 32)
            streams = Streams(self.file, *self.file.chunk(s["codebook"], most))
            read = streams.halves if s["element"] == 0 else streams.multiples(s["step"])
            columns = [read(s["num_entries"], f"{name}, number {d}", "CODE-4")
                       for d in range(self.dim(layer, c))]
            streams.end("CHNK-7")
            self.books[key] = list(zip(*columns))
        return self.books[key]

    def block_books(self, layer, block):
        """Component -> rows of the block codebook."""
        books = {}
        for table in block["tables"]:
            c, n = table["component"], table["num_entries"]
            require(c in (1, 2, 3) and self.component(layer, c)["coding"] == VQ and
                    self.component(layer, c)["rcq"] is not None, "RCQ-3", f"component {c}")
            require(1 <= n <= 65536, "RCQ-4", "entries")
            require(c not in books, "RCQ-5", "two tables")
            whole, residual = self.book(layer, c, 0), self.book(layer, c, RESIDUAL)
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
                require(r["sh_bytes"] > 0 or r["sh_offset"] == r["sh_hash"] == 0, "DIR-13",
                        "no second part")
                require(r["sh_bytes"] == 0 or self.has_detail() and
                        r["codec"] not in (STORED, ZSTD), "DIR-13", "a second part")
                box = [half(b) for b in r["bounds"]]
                require(all(map(math.isfinite, box)) and
                        all(a <= b for a, b in zip(box, box[3:])), "DIR-12", "bounds")
                previous = r
                self.take(r["offset"], r["stored_bytes"])
                self.take(r["sh_offset"], r["sh_bytes"])
                count += r["num_gaussians"]
                block = {} if r["block"] == NO_BLOCK else blocks[r["block"]]
                yield from self.page(index, layer, r, block)
        require(count == layer["num_gaussians"], "DIR-5", "Gaussians of a layer")

    def take(self, begin, size):
        """Bytes that no other page has."""
        at = bisect.bisect_left(self.parts, (begin, begin))
        require(size == 0 or (at == 0 or self.parts[at - 1][1] <= begin) and
                (at == len(self.parts) or begin + size <= self.parts[at][0]), "CHNK-4",
                f"pages share bytes at {begin}")
        if size > 0:
            self.parts.insert(at, (begin, begin + size))

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

    def entropy(self, index, layer):
        require(layer["entropy"] is not None and codable(self.header, layer), "RANS-6",
                "a rans32 page")
        if index not in self.entropies:
            most = 65794 + sum(n for _, n in page_planes(self.header, layer))
            self.entropies[index] = Entropy(
                self.file, *self.file.chunk(layer["entropy"], most), self.header, layer)
        return self.entropies[index]

    def has_detail(self):
        """Whether rans32 pages can have second parts."""
        sh = self.header["sh"]
        return sh["coding"] == VQ or (sh["coding"] == TRANSFORM and
                                      self.header["sh_base"] < len(sh["steps"]))

    def page(self, index, layer, record, block):
        h, n = self.header, record["num_gaussians"]
        numbers = 17 + self.dim(index, SH)
        most = n * (4 * numbers + 72) + 32 * (numbers + 36)
        chunk = self.file.chunk(record, most, h["payload_offset"], (STORED, ZSTD, RANS32))
        split = record["sh_bytes"] > 0
        base_only = split and self.base
        detail = None
        if split and not self.base:
            size = record["sh_bytes"]
            detail = self.file.chunk({"offset": record["sh_offset"], "hash": record["sh_hash"],
                                      "stored_bytes": size, "raw_bytes": size, "codec": STORED},
                                     most, h["payload_offset"])
        columns = (RansPage(self.file, chunk, detail, self.entropy(index, layer), split)
                   if record["codec"] == RANS32 else Streams(self.file, *chunk))

        def scalar(coding, what):
            if coding["coding"] == CONSTANT:
                return [coding["offset"]] * n
            if coding["coding"] == RAW32:
                return columns.floats(n, what)
            return [f32(coding["offset"] + f32(coding["step"] * code))
                    for code in columns.read(n, int(coding["bits"]), what)]

        if h["position"] == RAW32 or layer["raw_position"]:
            position = [columns.floats(n, f"position {axis}") for axis in "xyz"]
        else:
            position = columns.positions(n, h["position"] == FIXED, int(h["position_bits"]))
            if h["position"] == F16:
                position = [finite_halves(p, "position", "VAL-1") for p in position]
            position = [[f32(h["position_center"][axis] + f32(h["position_scale"] * v)) for v in p]
                        for axis, p in zip("xyz", position)]

        width = self.duration / num_buckets(layer["level"])
        center = h["time_begin"] + (record["bucket"] + 0.5) * width
        if layer["mean_t"] == RAW32:
            mean = columns.floats(n, "mean_t")
            exact, local = mean, [f32(v - center) for v in mean]
        elif layer["mean_t"] == RAW64:
            exact = columns.doubles(n, "mean_t")
            mean, local = [f32(v) for v in exact], [f32(v - center) for v in exact]
        else:
            local = [0.0] * n
            if layer["mean_t"] == F16:
                shift = int(layer["mean_t_shift"])
                coded = [(m << shift) + (1 << shift >> 1)
                         for m in columns.read(n, 16 - shift, "mean_t")]
                local = [f32(f32(width) * v) for v in finite_halves(coded, "mean_t", "VAL-1")]
            elif layer["mean_t"] == FIXED:
                codes = columns.read(n, int(layer["mean_t_bits"]), "mean_t")
                fine = (columns.read(n, 16, "mean_t_fine") if has_fine_mean_times(layer)
                        else [0] * n)
                local = [f32(layer["mean_t_step"] * f32(m - layer["mean_t_zero"] + part_of_step(v)))
                         for m, v in zip(codes, fine)]
            exact = [center + v for v in local]
            mean = [f32(v) for v in exact]

        opacity = scalar(h["opacity"], "opacity")
        if not h["opacity_logit"]:
            raw = h["opacity"]["coding"] == RAW32
            require(not raw or all(0 <= v <= 1 for v in opacity), "VAL-4", "opacity")
            opacity = [limit(v, 0.0, 1.0) for v in opacity]
        factor = scalar(layer["scale_factor"], "scale_factor")
        rows, classes = {}, [0] * n
        for c in columns.order:
            of_base = base_only and c == SH
            if of_base and h["sh_base"] == 0:
                rows[c] = [self.book(index, SH, BASIS)[0] if h["sh"]["coding"] == TRANSFORM else
                           [0.0] * self.dim(index, SH)] * n
            elif self.component(index, c)["coding"] == TRANSFORM:
                most = int(h["sh_base"]) if of_base else None
                rows[c], classes = self.transform(columns, index, c, n, classes, most)
            else:
                rows[c] = self.rows(columns, index, c, n, block.get(c))
        columns.end()
        if layer["scale"]["coding"] == RAW32:
            require(all(abs(v) <= 17 for row in rows[SCALE] for v in row), "VAL-4", "log scale")

        for i in range(n):
            log_scale = list(rows[SCALE][i])
            if layer["scale"]["coding"] != RAW32:
                log_scale = [limit(f32(factor[i] + v), -17.0, 17.0) for v in log_scale]
            if layer["permanent"]:
                log_scale.append(limit(layer["log_scale_t"], -17.0, 17.0))
            rotor = list(rows[ROTOR_SPATIAL][i]) + list(rows[ROTOR_TEMPORAL][i])
            if layer["rotor_spatial"]["coding"] == TRANSFORM:
                rotor = stereographic_rotor(rows[ROTOR_SPATIAL][i], rows[ROTOR_TEMPORAL][i])
            elif layer["rotor_spatial"]["coding"] != RAW32:
                rotor = normalize_rotor(rotor)
            yield {"position": [p[i] for p in position], "mean_t_local": [local[i]],
                   "mean_t": [mean[i]], EXACT: [exact[i]], "log_scale": log_scale, "rotor": rotor,
                   "opacity": [opacity[i]], "sh": list(rows[SH][i])}

    def rows(self, columns, layer, c, n, block_book):
        """Vectors of one component."""
        coding, dim, name = self.component(layer, c), self.dim(layer, c), COMPONENTS[c]
        if coding["coding"] == ZERO:
            return [[0.0] * dim] * n
        if coding["coding"] == RAW32:
            return list(zip(*[columns.floats(n, f"{name}, number {d}") for d in range(dim)]))
        stages = len(coding["stages"])
        books = [self.book(layer, c, s) for s in range(stages)]
        if block_book is not None:
            books[0] = block_book
        depth = [stages] * n
        if stages > 1 or coding["literals"]:
            depth = columns.read(n, 4, f"{name} depth")
            for d in depth:
                require(d <= stages or d == LITERAL and coding["literals"], "VQ-1", f"depth {d}")
        index = []
        for s in range(stages):
            count = sum(1 for d in depth if d != LITERAL and d > s)
            index.append(iter(columns.read(count, bit_width(len(books[s])),
                                           f"{name} index, stage {s}", len(books[s]), "VQ-2")))
        literals = sum(1 for d in depth if d == LITERAL)
        literal = zip(*[columns.halves(literals, f"{name} literal, number {d}", "VAL-2")
                        for d in range(dim if coding["literals"] else 0)])
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

    def transform(self, columns, layer, c, n, before, most=None):
        """Vectors of a component, and the classes. before: those of the transform before. most:
        coefficients that are there, if not all."""
        coding, dim, name = self.component(layer, c), self.dim(layer, c), COMPONENTS[c]
        ladder, steps = [0, *coding["ladder"]], coding["steps"][:most]
        basis = self.book(layer, c, BASIS)
        classes = columns.read(n, 4, f"{name} class", 16, columns.class_clause, before)
        rungs = [1] * n
        if len(coding["ladder"]) > 1:
            rungs = columns.read(n, bit_width(len(ladder)), f"{name} rung", len(ladder), "TRAN-6",
                                 classes)
        coefficients = [[] for _ in range(n)]
        for k in range(len(steps)):
            who = [i for i in range(n) if ladder[rungs[i]] > k]
            contexts = [coefficient_context(classes[i], coefficients[i]) for i in who]
            coded = columns.read(len(who), 16, f"{name} coefficient {k}", contexts=contexts)
            for i, z in zip(who, coded):
                coefficients[i].append((z >> 1) ^ -(z & 1))
        rows = []
        for i in range(n):
            row = list(basis[0])
            for k, q in enumerate(coefficients[i]):
                amount = f32((q * 2.0 ** -classes[i]) * steps[k])
                row = [f32(row[d] + f32(amount * basis[k + 1][d])) for d in range(dim)]
            rows.append(row)
        return rows, classes


def limit(v, low, high):
    return low if v < low else high if v > high else v


def coefficient_context(cls, before):
    """Of coefficient k of a Gaussian of class cls; before: its coefficients 0 to k-1."""
    if not before:
        return cls
    a = sum(map(abs, before[-2:]))
    return MAGNITUDES * cls + (0 if a == 0 else 1 if a < 3 else 2 if a < 7 else 3 if a < 15 else 4)


def normalize_half(v):
    squares = [f32(x * x) for x in v]
    norm2 = f32(f32(squares[0] + squares[1]) + f32(squares[2] + squares[3]))
    if norm2 < f32_of_bits(0x2B8CBCCC):
        return [1.0, 0.0, 0.0, 0.0]
    r = f32(math.sqrt(norm2))
    return [f32(x / r) for x in v]


def normalize_rotor(rotor):
    s, b01, b02, b12, b03, b13, b23, p = rotor
    return rotor_of(
        normalize_half([f32(s + p), f32(b01 - b23), f32(b02 + b13), f32(b12 - b03)]),
        normalize_half([f32(s - p), f32(b01 + b23), f32(b02 - b13), f32(b12 + b03)]))


def stereographic_half(w):
    w = [f32(f32(x + 1.5) - 1.5) for x in w]
    squares = [f32(x * x) for x in w]
    n2 = f32(f32(squares[0] + squares[1]) + squares[2])
    d = f32(1.0 + n2)
    return [f32(f32(1.0 - n2) / d)] + [f32(f32(x + x) / d) for x in w]


def stereographic_rotor(u, v):
    v = v[:3]                             # of four zeros where there is no temporal part
    return rotor_of(stereographic_half([f32(x + y) for x, y in zip(u, v)]),
                    stereographic_half([f32(x - y) for x, y in zip(u, v)]))


def rotor_of(a, b):
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
    return [f"{name} {i} {k} {bits_of(name, v)}"
            for i, g in enumerate(gaussians) for name, row in g.items() for k, v in enumerate(row)]


def bits_of(name, v):
    if name == EXACT:
        return struct.pack(">d", v).hex()
    return f"{bits_of_f32(v):08x}"


def decimals(gaussians):
    lines = []
    for i, g in enumerate(gaussians):
        for name, row in g.items():
            if name == EXACT:
                continue
            lines.append(f"Gaussian {i}  {name:<12}  " + "  ".join(f"{v:.9g}" for v in row))
    return lines


def decode(data, base=False):
    file = File(data)
    return file, list(Decoder(file, base).gaussians())


def main(arguments):
    only_values = "--values" in arguments
    paths = [a for a in arguments if not a.startswith("-")]
    try:
        file, gaussians = decode(Path(paths[0] if paths else HERE / "tiny.l4d").read_bytes(),
                                 "--base" in arguments)
    except (Invalid, NotImplementedError) as error:
        print(f"decode_tiny.py: {error}", file=sys.stderr)
        return 1
    print("\n".join(values(gaussians) if only_values else dump(file) + [""] + decimals(gaussians)))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

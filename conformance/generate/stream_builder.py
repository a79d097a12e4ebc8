# SPDX-License-Identifier: Apache-2.0
"""Streams built from a description, field by field: valid ones that no encoder would make, and
broken ones whose checksums are right.

A scene is the dictionary of a Header (names of spec/l4d.fbs) in which a component coding holds the
rows of its codebooks or of its basis, and a layer its pages and blocks and the raw bytes of its
entropy chunk. build() turns it into a file. To break a rule, put a "patch" of fields into a coding
(for its stages or basis), a page (for its record) or a layer (for its directory pages), or an
"entropy_patch" into a layer."""

import struct
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "spec" / "examples"))
sys.path.insert(0, str(ROOT / "conformance" / "reference"))

import frames                                       # noqa: E402
import make_tiny                                    # noqa: E402
from flatbuffer import SCALARS, Schema              # noqa: E402
from make_tiny import (Scalars, Struct, Table, write_flatbuffer,    # noqa: E402
                       zigzag_deltas)
from rng import Rng                                 # noqa: E402
from xxh3 import xxh3_64                            # noqa: E402

SCHEMA = Schema(ROOT / "spec" / "l4d.fbs")
COMPONENTS = ("scale", "rotor_spatial", "rotor_temporal")
NO_BLOCK = 0xFFFFFFFF


# ---- FlatBuffers from dictionaries ---------------------------------------------------------------

def pack_struct(name, d):
    out = b""
    for f in SCHEMA.fields[name]:
        size, align = SCHEMA.size_align(f.type)
        out += bytes(-len(out) % align)
        values = d[f.name] if f.count else [d.get(f.name, 0)]
        out += b"".join(struct.pack(SCALARS[f.type], v) for v in values)
    return Struct(out + bytes(-len(out) % SCHEMA.size_align(name)[1]))


def table(name, d):
    fields = []
    for slot, f in enumerate(SCHEMA.fields[name]):
        value = d.get(f.name)
        if value is None:
            continue
        form = pack_struct if SCHEMA.kinds.get(f.type) == "struct" else table
        if f.type in SCALARS and f.vector:
            fields.append((slot, "offset", Scalars(SCALARS[f.type][1:], value)))
        elif f.type in SCALARS:
            fields.append((slot, SCALARS[f.type][1:], value))
        elif f.type == "string":
            fields.append((slot, "offset", value.encode("utf-8")))
        elif f.vector:
            fields.append((slot, "offset", [form(f.type, v) for v in value]))
        else:
            kind = "struct" if form is pack_struct else "offset"
            fields.append((slot, kind, form(f.type, value)))
    return Table(*fields)


# ---- streams -------------------------------------------------------------------------------------

def order32(value):
    bits = struct.unpack("<I", struct.pack("<f", value))[0]
    return bits ^ (0xFFFFFFFF if bits >> 31 else 0x80000000)


def order64(value):
    bits = struct.unpack("<Q", struct.pack("<d", value))[0]
    return bits ^ (0xFFFFFFFFFFFFFFFF if bits >> 63 else 1 << 63)


def stream(rng, values, width):
    """A stream in one of the forms that can hold the values."""
    if not values or width == 0:
        return b""
    if len(set(values)) == 1 and rng.random() < 0.7:
        return make_tiny.constant(values[0], width)
    delta = 4 if width in (16, 32) and rng.random() < 0.4 else 0
    coded = zigzag_deltas(values, width) if delta else values
    if rng.random() < 0.6:
        out = make_tiny.packed(coded, width)
    elif rng.random() < 0.5:
        out = make_tiny.planes(coded, width)
    else:
        out = channels_with_frames(rng, coded, width)
    return bytes([out[0] | delta]) + out[1:]


def channels_with_frames(rng, values, width):
    """Byte planes of which some are zstd frames."""
    out = b"\x01"
    for p in range((width + 7) // 8):
        data = bytes(v >> 8 * p & 0xFF for v in values)
        frame = frames.frame(rng, data)
        # CHNK-8 leaves 32 bytes for the form of a stream.
        framed = len(frame) <= len(data) + 11 and rng.random() < 0.7
        out += b"\x01" + vlq(len(frame), rng.choice([0, 0, 1])) + frame if framed else b"\x00" + data
    return out


def vlq(value, spare=0):
    """spare: groups of zeros more than it takes."""
    groups = [value >> s & 0x7F for s in range(0, max(value.bit_length(), 1), 7)] + [0] * spare
    return bytes([g | 0x80 for g in groups[:-1]] + groups[-1:])


def halves(rng, values):
    return stream(rng, [make_tiny.order(v) for v in values], 16)


class Multiples(list):
    """Rows of a codebook whose numbers are integers, to be multiplied by a step."""

    def __init__(self, rows, step):
        super().__init__(rows)
        self.step = step


def codebook(rng, rows):
    if isinstance(rows, Multiples):
        zigzag = lambda q: 2 * q if q >= 0 else -2 * q - 1
        return b"".join(stream(rng, [zigzag(q) for q in column], 16) for column in zip(*rows))
    return b"".join(halves(rng, column) for column in zip(*rows))


def bit_width(limit):
    return (limit - 1).bit_length()


def rcq_table(rng, pairs, num_global, num_residual):
    return (stream(rng, [p[0] for p in pairs], bit_width(num_global)) +
            stream(rng, [p[1] for p in pairs], bit_width(num_residual)))


# ---- the file ------------------------------------------------------------------------------------

def build(scene, version=(1, 0), flags=1, rng=None, unknown_fields=False, zstd=0.0, header_last=False,
          streamable=None, more_bytes=None, footer=b""):
    """zstd: how likely a chunk is to be a zstd frame. header_last: the scene header is at the end.
    streamable: the streamable layout; a function of ("pages" or "directory", what lies in its order), which
    returns the order to take. An extension with "raw" has a chunk of these bytes. more_bytes: file_bytes is the size
    and these. footer: the last bytes of the file; a function of its size may return them."""
    header, rng = dict(scene), rng or Rng(0)
    payload, codebooks = [], []           # (reference to fill, stored bytes)

    def chunk(raw, to, may_be_zstd=True, **patch):
        codec = int(may_be_zstd and zstd > 0 and rng.random() < zstd)
        stored = frames.frame(rng, raw) if codec else raw
        ref = {"hash": xxh3_64(stored), "stored_bytes": len(stored), "raw_bytes": len(raw), "codec": codec,
               "offset": 1, **patch}
        to.append((ref, stored))
        return ref

    def coding(c):
        also = c.get("also", {})          # fields that the coding ignores
        if c["coding"] not in (2, 3):
            return {"coding": c["coding"], **also}
        stage = lambda rows: {
            "num_entries": len(rows), "element": int(isinstance(rows, Multiples)),
            "step": getattr(rows, "step", -1.0),      # meaningless in others
            "codebook": chunk(codebook(rng, rows) + c.get("suffix", b""), codebooks),
            **c.get("patch", {})}
        if c["coding"] == 3:
            basis = stage(c["basis"]) if c["basis"] else None
            return {"coding": 3, "basis": basis, "steps": c["steps"], "eob_table": c["eob_table"],
                    **also}
        out = {"coding": 2, "escapes": c["escapes"],
               "stages": [stage(rows) for rows in c["stages"]], **also}
        if c.get("rcq"):
            out["rcq"] = stage(c["rcq"])
        return out

    if scene.get("extensions") is not None:
        header["extensions"] = [
            {"id": e["id"], "critical": e["critical"], "chunk": chunk(e["raw"], codebooks, False, **e.get("patch", {}))}
            if "raw" in e else e for e in scene["extensions"]]
    header["sh"] = coding(scene["sh"])
    header["layers"] = [
        dict(layer, **{c: coding(layer[c]) for c in COMPONENTS}, page_table_offset=1,
             entropy=chunk(layer["entropy"], codebooks, False, **layer.get("entropy_patch", {}))
             if layer.get("entropy") is not None else None)
        for layer in scene["layers"]]
    directories = [
        [directory_page(index, layer, d, chunk, payload) for d in range(layer["table_size"])]
        for index, layer in enumerate(scene["layers"])]

    # Payload first, for its offsets are relative, then the directory, which holds them.
    at = rng.randrange(20)
    shuffled = payload[:]
    rng.shuffle(shuffled)
    if streamable is not None:
        at = 0
        shuffled = streamable("pages", in_streamable_order(scene, directories, payload))
    tail = bytearray(rng.randbytes(at))
    for ref, raw in shuffled:
        ref["offset"] = len(tail)
        tail += raw + rng.randbytes(rng.randrange(3))

    header["payload_offset"] = 1
    header["file_bytes"] = None if more_bytes is None else 1
    def scene_header():
        root = table("Header", header)
        if unknown_fields:                # of a later minor version
            root.fields.extend([(30, "Q", 0xFFFFFFFFFFFFFFFF), (31, "offset", Table((0, "B", 1)))])
        return write_flatbuffer(root, b"L4DH")

    size = len(scene_header())
    at = 40 if header_last else 40 + size
    body = bytearray()
    for ref, raw in codebooks:
        body += rng.randbytes(rng.randrange(3))
        ref["offset"] = at + len(body)
        body += raw
    if streamable is not None:
        body += streamable_directory(scene, header, directories, chunk, at + len(body), streamable)
    for index, pages in enumerate(directories if streamable is None else []):
        stored, entries = [], []
        for p in pages:
            ref = chunk(write_flatbuffer(table("DirectoryPage", p), b"L4DD"), stored) if p else {}
            entries.append(ref)
            if p:
                ref["offset"] = at + len(body)
                body += stored[-1][1] + rng.randbytes(rng.randrange(3))
        header["layers"][index]["page_table_offset"] = at + len(body)
        for ref in entries:
            body += table_entry(ref)
    header["payload_offset"] = at + len(body)
    whole = 40 + size + len(body) + len(tail) + (24 if callable(footer) else len(footer))
    header["file_bytes"] = None if more_bytes is None else whole + more_bytes
    footer = footer(whole) if callable(footer) else footer
    raw = scene_header()
    assert len(raw) == size
    if header_last:
        place = at + len(body) + len(tail)
        return file_header(raw, version, flags, place) + bytes(body) + bytes(tail) + raw + footer
    return file_header(raw, version, flags) + raw + bytes(body) + bytes(tail) + footer


def begin_of_bucket(layer, bucket):
    return 1 + (bucket << 39 - layer["level"]) if layer["level"] > 0 else 0


def in_streamable_order(scene, directories, payload):
    places = {}                           # of the reference of a chunk
    for index, (layer, pages) in enumerate(zip(scene["layers"], directories)):
        for page in filter(None, pages):
            for p in page["pages"]:
                place = (begin_of_bucket(layer, p["bucket"]), layer.get("tier", 0), index, p["bucket"])
                places[id(p.ref)], places[id(p.detail)] = (*place, 1), (*place, 2)
                if p["block"] == NO_BLOCK:
                    continue
                for t in page["blocks"][p["block"]]["tables"]:
                    places.setdefault(id(t["table"]), (*place, 0))
    return sorted(payload, key=lambda part: places[id(part[0])])


def streamable_directory(scene, header, directories, chunk, at, streamable):
    """Page tables and directory pages from byte `at` of the file on."""
    stored, begins = [], {}
    entries = [[chunk(write_flatbuffer(table("DirectoryPage", p), b"L4DD"), stored) if p else {} for p in pages]
               for pages in directories]
    for layer, refs in zip(scene["layers"], entries):
        begins.update((id(ref), begin_of_bucket(layer, d << layer["directory_bits"])) for d, ref in enumerate(refs))
    pages = streamable("directory", sorted(stored, key=lambda part: begins[id(part[0])]))
    place = at + 32 * sum(map(len, entries))
    for ref, raw in pages:
        ref["offset"] = place
        place += len(raw)
    tables = b""
    for index, refs in enumerate(entries):
        header["layers"][index]["page_table_offset"] = at + len(tables)
        tables += b"".join(map(table_entry, refs))
    return tables + b"".join(raw for _, raw in pages)


def table_entry(ref):
    """Of a page table; {} where there is no directory page."""
    keys = ("offset", "hash", "stored_bytes", "raw_bytes", "codec")
    entry = struct.pack("<QQIII", *(ref.get(key, 0) for key in keys))
    return entry + struct.pack("<I", xxh3_64(entry) & 0xFFFFFFFF)


def file_header(scene_header, version=(1, 0), flags=1, place=40):
    head = struct.pack("<8sBBHIQQ", bytes.fromhex("894c34440d0a1a0a"), *version, flags,
                       len(scene_header), place, xxh3_64(scene_header))
    return head + struct.pack("<Q", xxh3_64(head))


def directory_page(index, layer, d, chunk, payload):
    records = [p for p in layer["pages"] if p["bucket"] >> layer["directory_bits"] == d]
    if not records:
        return None
    out = {"layer": index, "index": d, "blocks": [], "pages": [], **layer.get("patch", {})}
    for tables in layer["blocks"].get(d, []):
        out["blocks"].append({"tables": [
            {"component": c, "num_entries": n, "table": chunk(raw, payload)}
            for c, n, raw in tables]})
    for p in records:
        ref = chunk(p["raw"], payload, p.get("codec", 0) == 0)
        detail = chunk(p["detail"], payload, False) if p.get("detail") else {}
        out["pages"].append(PageRecord(p, ref, detail))
    return out


class PageRecord(dict):
    """A record whose chunks get their places later."""

    OF_DETAIL = {"sh_offset": "offset", "sh_hash": "hash", "sh_bytes": "stored_bytes"}

    def __init__(self, page, ref, detail):
        left_out = ("raw", "detail", "patch", "columns")
        super().__init__({k: v for k, v in page.items() if k not in left_out})
        self.ref, self.detail = ref, detail
        self.update(page.get("patch", {}))

    def get(self, key, default=None):
        if key in self:
            return self[key]
        if key in self.OF_DETAIL:
            return self.detail.get(self.OF_DETAIL[key], default)
        return self.ref.get(key, default)


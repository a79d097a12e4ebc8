#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Rewrites a stream as a later version might have written it.

  later_version.py 1.1 IN OUT    with all that a minor version may add: unknown fields in every table,
                                 an unknown extension with a chunk, flags 1 and 3 to 7, `reserved` of structs
  later_version.py 2.0 IN OUT    the same bytes under another major version

The pages, and so the Gaussians, stay as they are. The scene header and the directory pages are written
again behind the end; their old bytes are such that nothing refers to.
"""

import struct
import sys
from pathlib import Path

import generator_path           # its import makes the following ones possible
import stream_builder as sb
from decoder import Decoder
from make_tiny import Scalars, Table, write_flatbuffer
from times import directory_pages
from xxh3 import xxh3_64

EXPERIMENTAL = 0xF0000000       # ids of extensions that no registry assigns
FIRST_UNKNOWN = 40              # slots of fields; no table has so many
CHUNK = b"an extension of version 1.1"


def unknown_fields():
    """A number, a table, a text, and a vector."""
    forms = ("Q", (1 << 64) - 1), ("offset", Table((0, "B", 1))), ("offset", b"1.1"), (
        "offset", Scalars("f", [float("nan"), 1.0]))
    return [(FIRST_UNKNOWN + k, form, value) for k, (form, value) in enumerate(forms)]


def add_unknown_fields(table):
    """To a table and to all below it. Returns how many tables there are."""
    count = 1
    for _, _, value in table.fields:
        children = value if isinstance(value, list) else [value]
        count += sum(add_unknown_fields(child) for child in children if isinstance(child, Table))
    table.fields.extend(unknown_fields())
    return count


def fill_reserved(fields):
    """Sets `reserved` of all ChunkRefs and PageRecords below."""
    for key, value in fields.items():
        if key == "reserved":
            fields[key] = 0xFF
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, dict):
                fill_reserved(child)


def file_header(data, version, flags, header_bytes, header_offset, header_hash):
    head = struct.pack("<8sBBHIQQ", data[:8], *version, flags, header_bytes, header_offset, header_hash)
    data[:40] = head + struct.pack("<Q", xxh3_64(head))


def next_minor(data, minor=1, critical=False):
    """The stream as 1.`minor`. critical: of the extension, which a decoder then refuses."""
    decoder, out = Decoder(data), bytearray(data)

    def append(raw):
        out.extend(bytes(-len(out) % 8))
        out.extend(raw)
        return len(out) - len(raw)

    def buffer(name, fields, identifier):
        fill_reserved(fields)
        table = sb.table(name, fields)
        add_unknown_fields(table)
        return write_flatbuffer(table, identifier)

    header = dict(decoder.header)
    for index, layer in enumerate(header["layers"]):
        number = directory_pages(layer["level"], int(layer["directory_bits"]))
        for d in range(number if layer["num_gaussians"] else 0):
            page = decoder.directory.page(index, d)
            if page is None:
                continue
            raw = buffer("DirectoryPage", page, b"L4DD")
            entry = struct.pack("<QQIII", append(raw), xxh3_64(raw), len(raw), len(raw), 0)
            at = int(layer["page_table_offset"]) + 32 * d
            out[at:at + 32] = entry + struct.pack("<I", xxh3_64(entry) & 0xFFFFFFFF)
    chunk = {"offset": append(CHUNK), "hash": xxh3_64(CHUNK), "stored_bytes": len(CHUNK),
             "raw_bytes": len(CHUNK), "codec": 0, "reserved": 0}
    header["extensions"] = [*(header["extensions"] or ()),
                            {"id": EXPERIMENTAL + 1, "critical": critical, "chunk": chunk}]
    raw = buffer("Header", header, b"L4DH")
    # What is added lies at the end: that is not the streamable layout.
    flags = (int.from_bytes(data[10:12], "little") | 0xFE) & ~4
    file_header(out, (1, minor), flags, len(raw), append(raw), xxh3_64(raw))
    return bytes(out)


def next_major(data, version=(2, 0)):
    out = bytearray(data)
    file_header(out, version, *struct.unpack_from("<HIQQ", data, 10))
    return bytes(out)


if __name__ == "__main__":
    if len(sys.argv) != 4 or sys.argv[1] not in ("1.1", "2.0"):
        sys.exit(__doc__)
    rewrite = next_minor if sys.argv[1] == "1.1" else next_major
    Path(sys.argv[3]).write_bytes(rewrite(Path(sys.argv[2]).read_bytes()))

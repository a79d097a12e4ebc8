# SPDX-License-Identifier: Apache-2.0
"""The file header and chunks, sections 6 and 7 of spec/l4d.md."""

import struct
from pathlib import Path

import zstd
from arithmetic import located, require
from flatbuffer import FlatBuffer, Schema
from xxh3 import xxh3_64

SCHEMA = Schema(Path(__file__).resolve().parents[2] / "spec" / "l4d.fbs")
MAGIC = bytes.fromhex("894c34440d0a1a0a")
STORED, ZSTD, RANS32 = range(3)     # chunk-codec


class Chunk:
    """The raw bytes of a chunk. place(i) is where raw byte i lies in the file: of a zstd frame, where
    that begins."""

    def __init__(self, raw, at, is_stored=True):
        self.raw, self.at, self.is_stored = raw, at, is_stored

    def place(self, i):
        return self.at + i if self.is_stored else self.at


class File:
    """explain: keep in `claims` what every byte that is read means, as (begin, end, text)."""

    def __init__(self, data, explain=False):
        self.data, self.claims, self.explain, self.flags = data, [], explain, 0

    def claim(self, begin, end, text):
        if self.explain:
            self.claims.append((begin, end, text))

    def limit(self, file_bytes):
        """Bytes behind file_bytes are not of the stream; 0: all are."""
        self.data = self.data[:file_bytes] if file_bytes > 0 else self.data

    def bytes(self, offset, n):
        require(offset + n <= len(self.data), "CHNK-1", f"bytes {offset}..{offset + n}", offset)
        return self.data[offset:offset + n]

    def chunk(self, ref, most, base=0, codecs=(STORED, ZSTD)):
        """The Chunk that a ChunkRef, page table entry or PageRecord locates, of at most `most` raw
        bytes. base: what its offset counts from. codecs: the ones that it may have."""
        at = base + ref["offset"]
        require(at < 1 << 64, "CHNK-1", f"offset {at}")
        stored = self.bytes(at, ref["stored_bytes"])
        with located(at):
            require(xxh3_64(stored) == ref["hash"], "CHNK-2", f"hash of the chunk at {at}")
            require(ref["codec"] in codecs, "CHNK-6", f"codec {ref['codec']}")
            require(ref["raw_bytes"] <= most, "CHNK-8", f"{ref['raw_bytes']} raw bytes")
            if ref["codec"] == ZSTD:
                raw = zstd.decompress(stored, ref["raw_bytes"])
                require(len(raw) == ref["raw_bytes"], "CHNK-5", "size of what a frame holds")
                self.claim(at, at + len(stored), f"a zstd frame of {len(raw)} bytes")
                return Chunk(raw, at, is_stored=False)
            require(ref["stored_bytes"] == ref["raw_bytes"], "CHNK-3", "sizes of a chunk")
        return Chunk(stored, at)

    def flatbuffer(self, chunk, name, identifier, clause, most_tables=100000):
        def claim(begin, end, text):
            if chunk.is_stored:
                self.claim(chunk.at + begin, chunk.at + end, text)
        base = chunk.at if chunk.is_stored else None
        with located(chunk.at):
            return FlatBuffer(SCHEMA, chunk.raw, clause, claim, base, most_tables).root(
                name, identifier)

    def scene_header(self):
        """The Chunk of the scene header, from what the file header says of it."""
        d = self.data
        require(d[:8] == MAGIC[:len(d[:8])], "FILE-1", "magic", 0)
        require(len(d) >= 40, "FILE-1", f"a file of {len(d)} bytes", len(d))
        major, minor, flags, header_bytes, offset, header_hash, own_hash = struct.unpack_from(
            "<BBHIQQQ", d, 8)
        self.flags = flags
        require(own_hash == xxh3_64(d[:32]), "FILE-4", "hash of the file header", 32)
        require(major == 1, "FILE-2", f"version {major}.{minor}", 8)
        require(flags & 0xFF00 == 0, "FILE-3", f"flags {flags:04x}", 10)
        require(header_bytes > 0, "FILE-5", "size of the scene header", 12)
        require(offset >= 40, "FILE-5", "place of the scene header", 16)
        for begin, end, text in (
                (0, 8, "magic"), (8, 9, f"version_major = {major}"),
                (9, 10, f"version_minor = {minor}"),
                (10, 12, f"flags = 0x{flags:04x}" + ": development" * (flags & 1)),
                (12, 16, f"header_bytes = {header_bytes}"), (16, 24, f"header_offset = {offset}"),
                (24, 32, "header_hash: XXH3-64 of the scene header"),
                (32, 40, "file_header_hash: XXH3-64 of bytes 0 to 31")):
            self.claim(begin, end, text)
        raw = self.bytes(offset, header_bytes)
        require(xxh3_64(raw) == header_hash, "FILE-6", "hash of the scene header", offset)
        return Chunk(raw, offset)

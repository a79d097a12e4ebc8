# SPDX-License-Identifier: Apache-2.0
"""The members of a file, their edits and the index: section 20 of spec/l4d.md."""

import contextlib
import math
import struct
from dataclasses import dataclass

from arithmetic import Invalid, located, require, sound
from file import MAGIC, STORED, File
from header import binary32, check_header
from times import duration
from xxh3 import xxh3_64

MEMBER, EDIT = 1, 2                 # extensions
MEDIA, STANDING, INDEX = range(3)   # member-role
MOST_BYTES = 1 << 27
FOOTER_MAGIC, FOOTER_BYTES = b"L4DINDEX", 24
SIGNATURE_MAGIC, SIGNATURE_BYTES = b"L4DS", 100
DEFAULT_RENDERING = {"dilation": 0.3, "cutoff": 0.0, "min_alpha": 1 / 255, "max_alpha": 0.999, "compensation": False}
RECORD = ("offset", "bytes", "header_hash", "begin", "end", "shift", "number", "role", "num_needs")


@dataclass
class Member:
    """A member; data: its bytes. The fields of RECORD, and `needs`."""

    data: bytes
    offset: int
    header: dict
    own: dict                       # the chunk of extension 1
    edit: dict                      # None: none
    chunks: list                    # of both extensions

    @property
    def span(self):
        h, shift = self.header, self.own["shift"]
        begin, end = h["time_begin"], h["time_begin"] + duration(h)
        if self.edit is not None:
            begin, end = self.edit["begin"], self.edit["end"]
        return begin + shift, end + shift

    @property
    def needs(self):
        return list(self.own["needs"] or ())

    def record(self):
        begin, end = self.span
        values = (self.offset, len(self.data), int.from_bytes(self.data[32:40], "little"), begin, end,
                  self.own["shift"], self.own["number"], self.own["role"], len(self.needs))
        return dict(zip(RECORD, values))


@contextlib.contextmanager
def in_member(offset):
    """Places in a member become places in the file."""
    try:
        yield
    except Invalid as broken:
        broken.offset = offset + (broken.offset or 0)
        raise


def read_member(data, offset, before):
    """The member that begins at a byte of a file; before: the members before it."""
    file = File(data[offset:])
    with in_member(offset):
        chunk = file.scene_header()
        header = file.flatbuffer(chunk, "Header", b"L4DH", "HEAD-1")
        check_header(header, len(chunk.raw), needs_are_shown=True)
        size = int(header["file_bytes"]) or len(file.data)
        require(size <= len(file.data), "HEAD-21", f"a stream of {size} bytes, {len(file.data)} are there")
        require(chunk.at + len(chunk.raw) <= size, "HEAD-21", "the scene header lies behind its stream")
        file = File(file.data[:size])
        number = before[-1].own["number"] + 1 if before else 0
        own = {"stream": before[0].own["stream"] if before else 0, "number": number, "role": MEDIA, "shift": 0.0,
               "needs": None, "records": None, "record_needs": None}
        edit, chunks, seen = None, [], set()
        for e in header["extensions"] or ():
            if e["id"] not in (MEMBER, EDIT):
                continue
            require(e["id"] not in seen, "MEMB-1", f"two extensions {e['id']}")
            seen.add(e["id"])
            ref = e["chunk"] or {"offset": 0, "stored_bytes": 0, "raw_bytes": 0, "codec": 0, "hash": xxh3_64(b"")}
            require(ref["codec"] == STORED and ref["raw_bytes"] <= MOST_BYTES and
                    ref["stored_bytes"] == ref["raw_bytes"], "MEMB-2", "a chunk of an extension")
            chunks.append(ref)
            found = file.chunk(ref, MOST_BYTES)
            if e["id"] == EDIT:
                edit = file.flatbuffer(found, "Edit", b"L4DE", "MEMB-2")
                check_edit(header, edit)
            else:
                own = file.flatbuffer(found, "Member", b"L4DM", "MEMB-2")
                check_member(own, e["critical"])
        return Member(file.data, offset, header, own, edit, chunks)


def check_edit(header, edit):
    begin = header["time_begin"]
    require(begin <= edit["begin"] < edit["end"] <= begin + duration(header), "MEMB-3", "edit")


def check_member(own, critical):
    require(sound(own["shift"]), "MEMB-4", "shift")
    needs = own["needs"] or ()
    require(all(a < b for a, b in zip(needs, needs[1:])) and all(n < own["number"] for n in needs) and
            (not needs or (own["role"] == MEDIA and critical)), "MEMB-5", "needs")


def members(data):
    """Member after member of a file. Raises Invalid at the first that is not whole or breaks a rule."""
    out, offset, media_end, first = [], 0, -math.inf, None
    while offset < len(data) or not out:
        rest = len(data) - offset
        if out and rest == SIGNATURE_BYTES and data[offset:offset + 4] == SIGNATURE_MAGIC:
            return
        try:
            m = read_member(data, offset, out)
        except Invalid as broken:
            if out and data[offset:offset + 8] != MAGIC[:rest]:
                raise Invalid("MEMB-6", "what follows is no member", offset) from broken
            raise
        with located(offset):
            check_order(m, out)
            if m.own["role"] != INDEX:
                require(first in (None, frame(m.header)), "MEMB-11", f"frame of member {m.own['number']}")
                first = frame(m.header)
            if m.own["role"] == MEDIA:
                begin, end = m.span
                require(begin < end and begin >= media_end, "MEMB-8", f"span of member {m.own['number']}")
                media_end = end
        out.append(m)
        offset += len(m.data)
        yield m


def check_order(m, before):
    """MEMB-6, MEMB-7"""
    if before:
        require(before[-1].own["number"] < m.own["number"], "MEMB-6", "numbers")
        require(before[0].own["stream"] == m.own["stream"], "MEMB-6", "streams")
    first = before[0].own["number"] if before else m.own["number"]
    standing = {b.own["number"] for b in before if b.own["role"] == STANDING}
    for number in m.needs:
        require(number in standing or number < first, "MEMB-7", f"it needs member {number}")


def frame(header):
    """What makes places, colours and pictures of the numbers of a scene."""
    rendering = {**DEFAULT_RENDERING, **(header["rendering"] or {})}
    return (header["world_scale"], header["coordinate_system"], header["color_space"], header["origin"],
            {key: binary32(value) for key, value in rendering.items()})


def check_index(found):
    """MEMB-9, MEMB-10 of all members of a file."""
    last = found[-1]
    if last.own["role"] != INDEX:
        return
    with located(last.offset):
        records = [{key: r[key] for key in RECORD} for r in last.own["records"] or ()]
        needs = [number for m in found[:-1] for number in m.needs]
        require(records == [m.record() for m in found[:-1]] and list(last.own["record_needs"] or ()) == needs,
                "MEMB-9", "records")
        footer = last.data[-FOOTER_BYTES:]
        require(footer == footer_of(len(last.data)), "MEMB-10", "footer")


def footer_of(size):
    head = FOOTER_MAGIC + struct.pack("<Q", size)
    return head + struct.pack("<Q", xxh3_64(head))

# SPDX-License-Identifier: Apache-2.0
"""Files of several members, streams with edits, and those that break a rule of section 20."""

import copy
import struct

import stream_builder as sb     # its import makes the following ones possible
from broken_streams import FIRST, put, scene
from make_tiny import write_flatbuffer
from members import EDIT, INDEX, MEDIA, MEMBER, RECORD, STANDING, footer_of, members
from xxh3 import xxh3_64

BEGIN, LENGTH = 1.0, 0.5            # of the sequence of scene()


def member(number, role=MEDIA, needs=(), shift=0.0, critical=None, **own):
    """An extension 1."""
    table = sb.table("Member", {"number": number, "role": role, "shift": shift, **own,
                                **({"needs": list(needs)} if needs else {})})
    return {"id": MEMBER, "critical": bool(needs) if critical is None else critical,
            "raw": write_flatbuffer(table, b"L4DM")}


def edit(begin, end):
    return {"id": EDIT, "critical": False,
            "raw": write_flatbuffer(sb.table("Edit", {"begin": begin, "end": end}), b"L4DE")}


def stream(*extensions, more_bytes=0, footer=b"", only=None, change=None, **build):
    """only: the one layer that it has. change: fields of the header."""
    s = {**copy.deepcopy(scene()), **(change or {})}
    if only is not None:
        s["layers"] = [s["layers"][only]]
        s["num_gaussians"] = s["layers"][0]["num_gaussians"]
    if extensions:
        s["extensions"] = list(extensions)
    return sb.build(s, rng=FIRST, more_bytes=more_bytes, footer=footer, **build)


def index(data, number, footer=footer_of, records=None, needs=None, **own):
    """The index of what stands in data, behind it."""
    found = list(members(data))
    s = copy.deepcopy(scene())
    s["layers"] = [dict(la, num_gaussians=0, pages=[], blocks={}) for la in s["layers"][:1]]
    s["num_gaussians"] = 0
    table = {"records": [m.record() for m in found] if records is None else records,
             "record_needs": [n for m in found for n in m.needs] if needs is None else needs, **own}
    s["extensions"] = [member(number, INDEX, **table)]
    return data + sb.build(s, rng=FIRST, more_bytes=0, footer=footer)


def live():
    """Standing and media members, as a writer that does not know the end makes them."""
    return (stream(member(0, STANDING), only=0) + stream(member(1, needs=[0]), only=1) +
            stream(member(2, STANDING, shift=0.5), only=0) +
            stream(member(5, needs=[0, 2], shift=LENGTH), edit(1.0, 1.25), only=1) +
            stream(member(6, shift=2 * LENGTH), only=1))


def signed(data):
    """With 100 bytes that look like a signature."""
    return data + b"L4DS" + bytes(96)


def valid():
    """(name, about, file, clauses)"""
    whole = live()
    yield "file-bytes", "a stream that says its size, and bytes of another one behind it", (
        stream() + stream(member(9, shift=LENGTH))), ["HEAD-21", "MEMB-6"]
    yield "edit", "a stream of which a part of the sequence is presented", stream(edit(1.125, 1.375), more_bytes=None), [
        "MEMB-2", "MEMB-3"]
    yield "members", "standing members, and media members that need them", whole, [
        "HEAD-21", "MEMB-4", "MEMB-5", "MEMB-6", "MEMB-7", "MEMB-8"]
    yield "members-index", "the same with an index", index(whole, 7), ["MEMB-9", "MEMB-10"]
    yield "members-signed", "the same with an index and what may be a signature", signed(index(whole, 7)), ["MEMB-6"]
    yield "members-rendering", "a rendering that one member states and another does not, of the same numbers", (
        stream(member(0), change={"rendering": None}) +
        stream(member(1, shift=LENGTH), change={"rendering": {}})), ["MEMB-11"]
    yield "members-behind-an-index", "an index behind which another member follows, and which is out of date", (
        index(whole, 7, records=[]) + stream(member(8, shift=3 * LENGTH), more_bytes=None)), ["MEMB-9"]
    yield "members-streamable", "a member in the streamable layout", stream(
        member(0, STANDING, shift=-1.0), edit(1.0, 1.5), flags=5, streamable=lambda what, parts: parts), ["FILE-7"]


def broken():
    """(clause, file), as broken_streams.broken"""
    nan, first, one = float("nan"), stream(member(0)), stream(member(3, shift=LENGTH))
    standing = stream(member(0, STANDING))
    yield "HEAD-21", stream(more_bytes=1)
    yield "HEAD-21 member", first + stream(member(1, shift=LENGTH), more_bytes=1)
    yield "HEAD-21 header", stream(more_bytes=-1, header_last=True)
    yield "CHNK-1 file bytes", stream(more_bytes=-1)
    yield "HEAD-8 needs", stream(member(3, needs=[0]))
    yield "MEMB-1", stream(member(0), member(0))
    yield "MEMB-1 edit", stream(edit(1.0, 1.25), edit(1.0, 1.5))
    yield "MEMB-2", stream({**member(0), "raw": edit(1.0, 1.5)["raw"]})
    yield "MEMB-2 edit", stream({**edit(1.0, 1.25), "raw": b""})
    yield "MEMB-2 codec", stream({**member(0), "patch": {"codec": 1}})
    yield "MEMB-2 size", stream({**member(0), "patch": {"raw_bytes": 1 << 28}})
    for name, begin, end in (("empty", 1.25, 1.25), ("early", 0.75, 1.25), ("late", 1.0, 1.75), ("nan", nan, 1.5)):
        yield f"MEMB-3 {name}", stream(edit(begin, end))
    for name, shift in (("nan", nan), ("large", 2.0 ** 61), ("small", 2.0 ** -61)):
        yield f"MEMB-4 {name}", stream(member(0, shift=shift))
    yield "MEMB-5 itself", stream(member(3, needs=[3]))
    yield "MEMB-5 order", stream(member(3, needs=[1, 0]))
    yield "MEMB-5 twice", stream(member(3, needs=[1, 1]))
    yield "MEMB-5 standing", stream(member(3, STANDING, needs=[1]))
    yield "MEMB-5 critical", stream(member(3, needs=[1], critical=False))
    yield "MEMB-6", first + bytes(100)
    yield "MEMB-6 few", first + b"\x00"
    yield "MEMB-6 number", first + stream(member(0, shift=LENGTH))
    yield "MEMB-6 stream", first + stream(member(1, shift=LENGTH, stream=7))
    yield "MEMB-7", standing + stream(member(2, needs=[1]))
    yield "MEMB-7 media", first + stream(member(2, needs=[0], shift=LENGTH))
    yield "MEMB-8", first + stream(member(2, shift=LENGTH / 2))
    yield "MEMB-8 back", stream(member(0, shift=4.0)) + stream(member(1))
    yield "MEMB-8 empty", stream(member(0, shift=2.0 ** 60))
    yield "MEMB-8 plain", stream() + stream()
    for name, key, value in (("origin", "origin", {"x": 1.0}), ("scale", "world_scale", 2.0),
                             ("axes", "coordinate_system", 2), ("colors", "color_space", 1),
                             ("rendering", "rendering", {"dilation": 0.1}),
                             ("compensation", "rendering", {"compensation": True})):
        yield f"MEMB-11 {name}", first + stream(member(1, shift=LENGTH), change={key: value})
    for key, value in (("offset", 1), ("bytes", 41), ("header_hash", 1), ("begin", 1.125), ("end", 1.375),
                       ("shift", 0.25), ("number", 1), ("role", STANDING)):
        records = [dict(m.record()) for m in members(first + one)]
        records[0][key] = value
        yield f"MEMB-9 {key}", index(first + one, 4, records=records)
    yield "MEMB-9 few", index(first + one, 4, records=[m.record() for m in members(first)])
    yield "MEMB-9 needs", index(first + one, 4, needs=[0])
    yield "MEMB-10", index(first + one, 4, footer=bytes(24))
    yield "MEMB-10 bytes", index(first + one, 4, footer=lambda size: footer_of(size - 1))
    yield "MEMB-10 hash", index(first + one, 4, footer=lambda size: footer_of(size)[:23] + b"\x00")

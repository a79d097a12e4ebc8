# SPDX-License-Identifier: Apache-2.0
"""Frames that break CHNK-5, in a page and in a byte plane. Each has a defect that every decoder of frames
finds; of frames without a checksum CHNK-5 lets decoders accept some that RFC 8878 calls corrupt."""

import broken_streams
import frames
import stream_builder as sb
from broken_streams import FIRST
from xxh3 import xxh3_64
from xxh64 import xxh64

HEAD = frames.MAGIC + b"\x00\x58"         # a window of 2 MiB, no size, no checksum
SUMMED = frames.MAGIC + b"\x04\x58"


def checksum(data):
    return (xxh64(data) & 0xFFFFFFFF).to_bytes(4, "little")


def flip(data, at):
    return data[:at] + bytes([data[at] ^ 1]) + data[at + 1:]


def whole(data):
    return frames.block(0, data, last=True)


def sequence(offset):
    """A block of 1 byte as it is and a copy of 3 from `offset` bytes before."""
    codes = bytes([0b01010100, 1, 2, 0])  # RLE tables: one literal, offsets of 4 to 7, three bytes
    return frames.small_section(0, 1) + b"A" + b"\x01" + codes + frames.bits_of([(offset + 3 - 4, 2)])


def wrong_frames(data):
    """(name, frame) for the raw bytes of a chunk"""
    size = len(data).to_bytes(4, "little")
    split = len(data) // 2
    yield "magic", b"\x27" + (HEAD + whole(data))[1:]
    yield "legacy", b"\x27\xb5\x2f\xfd" + HEAD[4:] + whole(data)
    yield "skippable", b"\x50\x2a\x4d\x18" + size + data
    yield "dictionary", frames.MAGIC + b"\x01\x58\x07" + whole(data)
    yield "reserved-bit", frames.MAGIC + b"\x08\x58" + whole(data)
    yield "window", frames.MAGIC + b"\x00\x89" + whole(data)        # 2^27 + 2^24
    yield "block-type", HEAD + frames.block(3, data, last=True)
    yield "block-size", HEAD + frames.block(1, b"A", (1 << 17) + 1, last=True)
    yield "no-last-block", HEAD + frames.block(0, data)
    yield "ends-early", (HEAD + whole(data))[:-1]
    yield "ends-in-header", HEAD[:5]
    yield "empty", b""
    yield "bytes-after", HEAD + whole(data) + b"\0"
    yield "two-frames", HEAD + whole(data[:split]) + HEAD + whole(data[split:])
    yield "too-many-bytes", HEAD + whole(data + b"\0")
    yield "too-few-bytes", HEAD + whole(data[:-1])
    yield "content-size", frames.MAGIC + b"\xa0" + (len(data) + 1).to_bytes(4, "little") + whole(data)
    yield "checksum", SUMMED + whole(data) + flip(checksum(data), 0)
    yield "checksum-of-other-bytes", SUMMED + whole(flip(data, 3)) + checksum(data)
    yield "checksum-missing", SUMMED + whole(data)
    yield "offset", HEAD + frames.block(2, sequence(2), last=True)


def page_of_frame(frame):
    """The first page of the scene of broken_streams as a zstd frame."""
    return broken_streams.edited(lambda s: s["layers"][0]["pages"][0].update(
        raw=frame, patch={"codec": 1, "raw_bytes": len(s["layers"][0]["pages"][0]["raw"])}))


def channel_of_frame(frame):
    """The low bytes of the x coordinates of that page as a frame."""
    new = b"\x01\x01" + sb.vlq(len(frame)) + frame + b"\x00\xbc\xc0\xc2"
    return broken_streams.page_edit(0, 0, (0, 7), new)


def faults():
    raw = broken_streams.scene()["layers"][0]["pages"][0]["raw"]
    for name, frame in wrong_frames(raw):
        yield f"CHNK-5 {name}", page_of_frame(frame)
    low = b"\x00\x00\x00"
    for name, frame in wrong_frames(low + b"\0"):
        if name in ("magic", "too-many-bytes", "checksum", "bytes-after", "ends-early"):
            yield f"CHNK-5 channel-{name}", channel_of_frame(frame)
    yield "CHNK-5 channel-too-few-bytes", channel_of_frame(HEAD + whole(low[:-1]))


def valid():
    """What the frames above would be without their defects."""
    raw = broken_streams.scene()["layers"][0]["pages"][0]["raw"]
    yield "frame", page_of_frame(SUMMED + whole(raw) + checksum(raw))
    yield "frame in a channel", channel_of_frame(HEAD + whole(b"\x00\x00\x00"))
    yield "copy", HEAD + frames.block(2, sequence(1), last=True)

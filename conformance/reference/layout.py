# SPDX-License-Identifier: Apache-2.0
"""The streamable layout, section 12.1 of spec/l4d.md."""

from arithmetic import require
from times import num_buckets

STREAMABLE = 4                      # bit 2 of the flags of a file
HEADERS, TABLES, PAGE_TABLES, DIRECTORY, PAYLOAD = range(5)


def begin(layer, bucket):
    """When a bucket begins. Level 0 comes before all others."""
    return bucket * ((1 << 40) // num_buckets(layer["level"])) if layer["level"] > 0 else -1


def directory_place(layer, d):
    return DIRECTORY, begin(layer, d << int(layer["directory_bits"]))


def payload_place(layer, bucket):
    return PAYLOAD, begin(layer, bucket), layer["tier"]


def block_places(layer, page):
    """Of the block codebooks of a directory page: that of the first bucket that uses the block."""
    users = [[r["bucket"] for r in page["pages"] if r["block"] == b]
             for b in range(len(page["blocks"] or ()))]
    first = int(page["index"]) << int(layer["directory_bits"])
    return [payload_place(layer, min(buckets, default=first)) for buckets in users]


def check_order(parts):
    """FILE-7. parts: (place in the file, place in the layout)."""
    parts = sorted(parts)
    for (_, a), (at, b) in zip(parts, parts[1:]):
        require(a <= b, "FILE-7", "a part lies behind one that comes later", at)

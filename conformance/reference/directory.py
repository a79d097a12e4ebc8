# SPDX-License-Identifier: Apache-2.0
"""Page tables and directory pages, section 12 of spec/l4d.md."""

import bisect
import math
import struct

from arithmetic import half, located, require
from file import RANS32
from header import has_detail
from times import directory_pages, num_buckets
from xxh3 import xxh3_64

NO_BLOCK = 0xFFFFFFFF
MOST_TABLES = 1025                  # of a directory page, DIR-2


class Directory:
    def __init__(self, file, header):
        self.file, self.header = file, header

    def entry(self, index, d):
        """Entry d of the page table of a layer, as a dictionary."""
        at = self.header["layers"][index]["page_table_offset"] + 32 * d
        data = self.file.bytes(at, 32)
        keys = ("offset", "hash", "stored_bytes", "raw_bytes", "codec", "entry_hash")
        values = struct.unpack("<QQIIII", data)
        require(values[5] == xxh3_64(data[:28]) & 0xFFFFFFFF, "DIR-1", "hash of an entry", at)
        name = f"page table of layer {index}, entry {d}"
        for begin, end, text in ((0, 8, f"offset = {values[0]}"), (8, 16, "hash"),
                                 (16, 20, f"stored_bytes = {values[2]}"),
                                 (20, 24, f"raw_bytes = {values[3]}"),
                                 (24, 28, f"codec = {values[4]}"),
                                 (28, 32, "entry_hash: low half of XXH3-64 of bytes 0 to 27")):
            self.file.claim(at + begin, at + end, f"{name}: {text}")
        return dict(zip(keys, values))

    def page(self, index, d):
        """A checked directory page, or None where its buckets are empty."""
        entry = self.entry(index, d)
        if entry["stored_bytes"] == 0:
            return None
        chunk = self.file.chunk(entry, 1 << 26)
        page = self.file.flatbuffer(chunk, "DirectoryPage", b"L4DD", "DIR-2", MOST_TABLES)
        with located(chunk.at):
            require((page["layer"], page["index"]) == (index, d), "DIR-2", "layer or index")
            require(len(page["blocks"] or ()) <= 256, "DIR-11", "blocks")
            self.check_records(index, d, page)
        return page

    def pages(self, index, first=0, last=None):
        """Directory pages of a layer, which are for the buckets from first to last or for all. The
        sum of their Gaussians is held against the layer's."""
        layer = self.header["layers"][index]
        bits, number = int(layer["directory_bits"]), directory_pages(layer["level"],
                                                                     layer["directory_bits"])
        begin, end = first >> bits, number - 1 if last is None else last >> bits
        count, place = 0, layer["page_table_offset"]
        for d in range(begin, end + 1):
            page = self.page(index, d)
            if page is None:
                continue
            count += sum(r["num_gaussians"] for r in page["pages"])
            require(count <= layer["num_gaussians"], "DIR-5", "Gaussians of a layer", place)
            yield page
        require(end + 1 - begin < number or count == layer["num_gaussians"], "DIR-5",
                "Gaussians of a layer", place)

    def check_records(self, index, d, page):
        layer, previous = self.header["layers"][index], None
        for r in page["pages"]:
            require(r["bucket"] >> int(layer["directory_bits"]) == d and
                    r["bucket"] < num_buckets(layer["level"]) and
                    (previous is None or r["bucket"] >= previous["bucket"]), "DIR-3", "bucket")
            require(1 <= r["num_gaussians"] <= 65536, "DIR-4", "num_gaussians")
            require(r["block"] == NO_BLOCK or r["block"] < len(page["blocks"] or ()), "DIR-6", "block")
            require(previous is None or previous["bucket"] != r["bucket"] or
                    previous["block"] == r["block"], "DIR-8", "blocks of a bucket")
            require(r["visible_begin"] <= r["visible_end"], "DIR-7", "visible interval")
            if r["sh_bytes"] == 0:
                require(r["sh_offset"] == r["sh_hash"] == 0, "DIR-13", "no SH chunk")
            else:
                require(has_detail(self.header) and r["codec"] >= RANS32, "DIR-13", "an SH chunk")
            box = [half(b) for b in r["bounds"]]
            require(all(map(math.isfinite, box)) and
                    all(a <= b for a, b in zip(box, box[3:])), "DIR-12", "bounds")
            previous = r


class Taken:
    """Ranges of the file of which none may overlap another (CHNK-4)."""

    def __init__(self):
        self.ranges = []                  # (begin, end), ascending

    def take(self, begin, size, what):
        if size == 0:
            return
        at = bisect.bisect_left(self.ranges, (begin, begin))
        require((at == 0 or self.ranges[at - 1][1] <= begin) and
                (at == len(self.ranges) or begin + size <= self.ranges[at][0]), "CHNK-4",
                f"{what} shares bytes with something else", begin)
        self.ranges.insert(at, (begin, begin + size))

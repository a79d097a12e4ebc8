# SPDX-License-Identifier: Apache-2.0
"""A decoder of the format of spec/l4d.md: opens a file and answers queries (sections 14 and 15)."""

from dataclasses import dataclass, field

from arithmetic import located
from codebooks import Codebooks
from directory import NO_BLOCK, Directory, Taken
from file import File
from header import check_header, component, vector_length
from page import Page
from reconstruct import attributes
from times import buckets_of_query, duration, may_be_visible, num_buckets


@dataclass
class Query:
    """What to decode: everything, the times from begin to end, or listed buckets."""

    begin: float = None                   # None: not by time
    end: float = None                     # an instant is begin = end
    buckets: list = None                  # of (layer, bucket), ascending
    most_level: int = 255                 # finer layers are left out
    most_tier: int = 255                  # and those of higher tiers
    base_only: bool = False               # leaves SH chunks of pages unread
    whole_buckets: bool = False           # takes all pages of a bucket if it needs one

    def in_layer(self, header, index):
        """Ranges of buckets (first, last) of a layer; (0, None) are all."""
        level = header["layers"][index]["level"]
        if self.buckets is not None:
            return [(b, b) for layer, b in self.buckets if layer == index]
        return [(0, None) if self.begin is None else
                buckets_of_query(header, level, self.begin, self.end)]


@dataclass
class Selected:
    """A page that a query selects."""

    index: int                            # of its layer
    record: dict
    directory_page: dict = field(repr=False)


class Decoder:
    def __init__(self, file, needs_are_shown=False):
        """file: bytes, or a File. needs_are_shown: the members that the stream needs are shown with it."""
        self.file = file if isinstance(file, File) else File(file)
        chunk = self.file.scene_header()
        self.header_at, self.header_bytes = chunk.at, len(chunk.raw)
        self.header = self.file.flatbuffer(chunk, "Header", b"L4DH", "HEAD-1")
        with located(chunk.at):
            check_header(self.header, len(chunk.raw), needs_are_shown)
        self.file.limit(int(self.header["file_bytes"]))
        self.duration = duration(self.header)
        self.directory = Directory(self.file, self.header)
        self.codebooks = Codebooks(self.file, self.header)
        self.blocks = {}                  # of the directory page at hand: codebooks of its blocks

    def component(self, layer, c):
        return component(self.header, layer, c)

    def dim(self, layer, c):
        return vector_length(self.header, layer, c)

    def select(self, query):
        """The pages that a query needs, in order (DEC-2)."""
        taken = Taken()
        for index, layer in enumerate(self.header["layers"]):
            if (layer["num_gaussians"] == 0 or layer["level"] > query.most_level or
                    layer["tier"] > query.most_tier):
                continue
            for first, last in self.runs(query, index):
                yield from self.select_of_layer(query, index, first, last, taken)

    def runs(self, query, index):
        """The ranges of buckets of a query; neighbours are joined."""
        out = []
        for first, last in query.in_layer(self.header, index):
            if out and out[-1][1] == first - 1:
                first = out.pop()[0]
            out.append((first, last))
        return out

    def select_of_layer(self, query, index, first, last, taken):
        layer = self.header["layers"][index]
        for page in self.directory.pages(index, first, last):
            end = num_buckets(layer["level"]) - 1 if last is None else last
            records = [r for r in page["pages"] if first <= r["bucket"] <= end]
            if query.begin is not None:
                wanted = [may_be_visible(self.header, layer, r, query.begin, query.end)
                          for r in records]
                whole = {r["bucket"] for r, w in zip(records, wanted) if w and query.whole_buckets}
                records = [r for r, w in zip(records, wanted) if w or r["bucket"] in whole]
            for r in records:
                base = self.header["payload_offset"]
                taken.take(base + r["offset"], r["stored_bytes"], "a page")
                taken.take(base + r["sh_offset"], r["sh_bytes"], "an SH chunk")
                yield Selected(index, r, page)

    def block_codebooks(self, selected):
        """Codebooks of the page's block, by component."""
        number, page = selected.record["block"], selected.directory_page
        if number == NO_BLOCK:
            return {}
        key = (selected.index, page["index"], number)
        if key not in self.blocks:
            self.blocks[key] = self.codebooks.of_block(selected.index, page["blocks"][number])
        return self.blocks[key]

    def page(self, selected, base_only=False):
        """The columns of a selected page."""
        return Page(self.file, self.codebooks, selected.index, selected.record,
                    self.block_codebooks(selected), base_only)

    def attributes(self, selected, base_only=False):
        """Name -> a row for each Gaussian of a selected page."""
        return self.page_and_attributes(selected, base_only)[1]

    def page_and_attributes(self, selected, base_only=False):
        with located(self.header["payload_offset"] + selected.record["offset"]):
            page = self.page(selected, base_only)
            return page, attributes(page, self.codebooks, self.block_codebooks(selected))

    def pages(self, query):
        """Attributes of page after page of what a query selects."""
        for selected in self.select(query):
            yield self.attributes(selected, query.base_only)

    def gaussians(self, query=None):
        """Name -> row, of Gaussian after Gaussian."""
        for page in self.pages(query or Query()):
            for row in zip(*page.values()):
                yield dict(zip(page, row))

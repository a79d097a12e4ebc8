# SPDX-License-Identifier: Apache-2.0
"""What a validator checks beside what a decoder meets: CHNK-4 of everything, FILE-7, DIR-9, DIR-10, LAYR-1, the LEVL
rules and all members of a file, sections 7, 12, 15, 18 and 20 of spec/l4d.md."""

import math

import layout
import levels
from arithmetic import half, require
from decoder import Decoder, Query
from directory import Taken
from header import COMPONENTS, FIXED, SH, TRANSFORM, VQ, WINDOW
from members import check_index, in_member, members
from rans import codable
from rotor import slice_of
from times import (LAST_PHASE, bucket_of_phase, clamp_time, directory_pages,
                   duration, phase_of_time, phases_of_window, visible_interval, width_of_bucket,
                   window_times)

NOWHERE = 65504.0                   # as a bound of a box: none


def validate_file(data):
    """Raises Invalid for a rule that a file or one of its members breaks."""
    found = []
    for member in members(data):
        with in_member(member.offset):
            validate(Decoder(member.data, needs_are_shown=True), member.chunks)
        found.append(member)
    check_index(found)


def validate(decoder, chunks=()):
    """Raises Invalid for the first rule that a stream breaks. chunks: of its extensions."""
    check_tables(decoder)
    check_ranges(decoder, chunks)
    for selected in decoder.select(Query()):
        place = decoder.header["payload_offset"] + selected.record["offset"]
        page, rows = decoder.page_and_attributes(selected)
        layer = decoder.header["layers"][selected.index]
        declared = layer["symbols_per_gaussian"]
        require(declared == 0 or page.symbols <= page.n * declared, "LEVL-9", f"{page.symbols} symbols", place)
        for position, mean, log_scale, rotor, window in zip(
                rows["position"], rows["mean_t_double"], rows["log_scale"], rows["rotor"],
                rows.get("window", rows["position"])):
            rate, velocity = slice_of(rotor, log_scale)
            check_gaussian(decoder.header, layer, selected.record, place,
                           position, mean[0], rate, velocity, window)
    levels.check(decoder)


def stages_of(decoder):
    """(layer, component, number of a stage, Stage) of all codebooks and bases."""
    for index in range(len(decoder.header["layers"])):
        for c in range(len(COMPONENTS)):
            if c == SH and index > 0:
                continue
            coding = decoder.component(index, c)
            if coding["coding"] == VQ:
                yield from ((index, c, k, s) for k, s in enumerate(coding["stages"]))
                if coding["rcq"] is not None:
                    yield index, c, "rcq", coding["rcq"]
            if coding["coding"] == TRANSFORM:
                yield index, c, "basis", coding["basis"]


def check_tables(decoder):
    """Codebooks and entropy chunks that perhaps no page uses."""
    names = {"rcq": 8, "basis": 9}
    for index, c, k, _ in stages_of(decoder):
        decoder.codebooks.codebook(index, c, names.get(k, k))
    for index, layer in enumerate(decoder.header["layers"]):
        if layer["entropy"] is not None and layer["num_gaussians"] > 0 and codable(decoder.header,
                                                                                  index):
            decoder.codebooks.entropy(index)


class TakenOfFile(Taken):
    def __init__(self, file_bytes):
        super().__init__()
        self.file_bytes, self.parts = file_bytes, []

    def take(self, begin, size, what, place):
        """place: in the streamable layout."""
        require(size == 0 or begin + size <= self.file_bytes, "CHNK-1", f"{what} beyond the file", begin)
        super().take(begin, size, what)
        self.parts += [(begin, place)] if size > 0 else []


def check_ranges(decoder, chunks):
    """CHNK-4, of all that the stream refers to; pages and block codebooks too. FILE-7."""
    taken, h = TakenOfFile(len(decoder.file.data)), decoder.header
    taken.take(0, 40, "the file header", (layout.HEADERS,))
    taken.take(decoder.header_at, decoder.header_bytes, "the scene header", (layout.HEADERS,))
    for ref in chunks:
        taken.take(ref["offset"], ref["stored_bytes"], "the chunk of an extension", (layout.HEADERS,))
    for _, _, _, stage in stages_of(decoder):
        ref = stage["codebook"]
        taken.take(ref["offset"], ref["stored_bytes"], "a codebook", (layout.TABLES,))
    for index, layer in enumerate(h["layers"]):
        if layer["num_gaussians"] == 0:
            continue
        if layer["entropy"] is not None:
            ref = layer["entropy"]
            taken.take(ref["offset"], ref["stored_bytes"], "an entropy chunk", (layout.TABLES,))
        number = directory_pages(layer["level"], layer["directory_bits"])
        taken.take(layer["page_table_offset"], 32 * number, "a page table", (layout.PAGE_TABLES,))
        for d in range(number):
            entry = decoder.directory.entry(index, d)
            taken.take(entry["offset"], entry["stored_bytes"], "a directory page",
                       layout.directory_place(layer, d))
        for page in decoder.directory.pages(index):
            check_ranges_of_payload(decoder, index, page, taken)
    if decoder.file.flags & layout.STREAMABLE:
        layout.check_order(taken.parts)


def check_ranges_of_payload(decoder, index, page, taken):
    """Of what one directory page refers to."""
    layer, base = decoder.header["layers"][index], decoder.header["payload_offset"]
    for block, place in zip(page["blocks"] or (), layout.block_places(layer, page)):
        for t in block["tables"]:
            taken.take(base + t["table"]["offset"], t["table"]["stored_bytes"], "a block codebook", place)
        decoder.codebooks.of_block(index, block)
    of_bucket = {}
    for r in page["pages"]:
        place = layout.payload_place(layer, r["bucket"])
        taken.take(base + r["offset"], r["stored_bytes"], "a page", place)
        taken.take(base + r["sh_offset"], r["sh_bytes"], "an SH chunk", place)
        chunks = of_bucket.setdefault(r["bucket"], [])
        chunks += [(base + r["offset"], (0,))]
        chunks += [(base + r["sh_offset"], (1,))] if r["sh_bytes"] > 0 else []
    for chunks in of_bucket.values():
        if decoder.file.flags & layout.STREAMABLE:
            layout.check_order(chunks)


def check_gaussian(h, layer, record, place, position, mean, rate, velocity, window):
    """rate: lambda."""
    begin, end = h["time_begin"], h["time_begin"] + duration(h)
    sigma = 1 / math.sqrt(rate)
    if layer["permanent"]:
        first, last = begin, end
    elif layer["mean_t"] == WINDOW:
        require(window_fits(h, layer["level"], record["bucket"], window), "LAYR-3",
                "a window reaches beyond the neighbouring buckets", place)
        first, last = [min(max(t, begin), end) for t in window_times(h, window)]
        check_interval(h, layer, record, place, first, last)
    else:
        require(fits_layer(h, layer["level"], record["bucket"], mean, sigma), "LAYR-1",
                "a Gaussian is visible beyond the neighbouring buckets", place)
        first, last = max(begin, mean - 4 * sigma), min(end, mean + 4 * sigma)
        if first > last:
            return
        check_interval(h, layer, record, place, first, last)
    check_bounds(h, record, place, position, mean, velocity, (first, last))


def fits_layer(h, level, bucket, mean, sigma):
    """LAYR-1"""
    if level == 0:
        return True
    reach = 4 * sigma * (1 + 2.0 ** -20)
    if mean + reach < h["time_begin"] or mean - reach > h["time_begin"] + duration(h):
        return True
    first = bucket_of_phase(max(phase_of_time(h, mean - reach) - 1, 0), level)
    last = bucket_of_phase(min(phase_of_time(h, mean + reach) + 1, LAST_PHASE), level)
    return abs(first - bucket) <= 1 and abs(last - bucket) <= 1


def window_fits(h, level, bucket, window):
    """LAYR-3"""
    return all(abs(bucket_of_phase(phase, level) - bucket) <= 1
               for phase in phases_of_window(h, window))


def check_interval(h, layer, record, place, first, last):
    """DIR-9"""
    slack = 1e-9 * width_of_bucket(h, layer["level"])
    begin, end = visible_interval(h, layer["level"], record)
    require((record["visible_begin"] == 0 or first >= begin - slack) and
            (record["visible_end"] == 255 or last <= end + slack), "DIR-9",
            "a Gaussian is visible outside the interval of its page", place)


def check_bounds(h, record, place, position, mean, velocity, times):
    """DIR-10"""
    unit = h["position_scale"]
    if h["position"] == FIXED:
        unit *= 2.0 ** max(int(h["position_bits"]) - 15, 0)
    reference = mean if h["position_at_mean_time"] else clamp_time(h, mean)
    box = [half(b) for b in record["bounds"]]
    for axis in range(3):
        low, high = box[axis], box[axis + 3]
        for t in times:
            x = position[axis] + velocity[axis] * (t - reference)
            coded = (x - h["position_center"]["xyz"[axis]]) / unit
            slack = abs(coded) * 1e-6
            require((low <= -NOWHERE or coded >= low - slack) and
                    (high >= NOWHERE or coded <= high + slack), "DIR-10",
                    "a Gaussian leaves the box of its page", place)

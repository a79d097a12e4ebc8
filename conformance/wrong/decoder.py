#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Deliberately wrong decoders: the reference decoder with one mistake each. The suite has to catch them all.

  decoder.py --list                      name, vector that is meant to catch it, mistake
  decoder.py NAME [ARGUMENT...] FILE     the decoder with that mistake, as the contract of the suite has it;
                                         NAME `none`: without a mistake
"""

import sys
from pathlib import Path

sys.dont_write_bytecode = True
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "reference"))

import arithmetic       # noqa: E402
import codebooks        # noqa: E402
import decoder          # noqa: E402
import directory        # noqa: E402
import file             # noqa: E402
import header           # noqa: E402
import l4d              # noqa: E402
import levels           # noqa: E402
import page             # noqa: E402
import rans             # noqa: E402
import reconstruct      # noqa: E402
import rotor            # noqa: E402
import streams          # noqa: E402
import times            # noqa: E402
import zstd             # noqa: E402

MISTAKES = {}


def mistake(vector, about):
    def keep(function):
        MISTAKES[function.__name__.replace("_", "-")] = (vector, about, function)
        return function
    return keep


def replaced_in_modules(old, new, *modules):
    """Gives a function another meaning in modules that imported it by name."""
    for module in modules:
        for name, value in list(vars(module).items()):
            if value is old:
                setattr(module, name, new)


@mistake("uncommon/deltas-at-the-border", "sums of deltas are not reduced modulo 2^width")
def delta_not_modular():
    def undo(coded, width):
        values, previous = [], 0
        for z in coded:
            previous += arithmetic.unzigzag(z)
            values.append(previous)
        return values
    streams.undo_delta = undo


@mistake("core/all-codebooks", "a delta is taken for a two's complement number")
def delta_without_zigzag():
    def undo(coded, width):
        values, previous = [], 0
        for z in coded:
            previous = (previous + z) % (1 << width)
            values.append(previous)
        return values
    streams.undo_delta = undo


@mistake("core/position-f16", "expressions are computed in binary64 and rounded once")
def rounds_once():
    replaced_in_modules(arithmetic.f32, lambda x: x, reconstruct, rotor)
    before = reconstruct.attributes
    decoder.attributes = lambda *a: {
        name: rows if name == "mean_t_double" else [[arithmetic.f32(v) for v in row] for row in rows]
        for name, rows in before(*a).items()}


@mistake("faulty/RANS-7-state", "the state of the last lane is not looked at")
def last_state_unchecked():
    def end(self):
        arithmetic.require(self.at == len(self.raw), "RANS-7", "words left over", self.place())
        arithmetic.require(all(x == rans.LOW for x in self.states[:31]), "RANS-7", "states")
    rans.Block.end = end


@mistake("faulty/RANS-7", "words that are left over are not noticed")
def words_left_over():
    def end(self):
        arithmetic.require(all(x == rans.LOW for x in self.states), "RANS-7", "states")
    rans.Block.end = end


@mistake("uncommon/fixed-21-rans", "pieces of raw bits are put together most significant first")
def pieces_in_the_wrong_order():
    before = rans.wide
    rans.wide = lambda token: (before(token)[0], before(token)[1][::-1])


@mistake("core/encoder-room-default", "the context takes only one coefficient into account")
def short_context():
    before = rans.coefficient_context
    page.coefficient_context = lambda exponent, coefficients: before(
        exponent, [0, *coefficients[-1:]] if coefficients else [])


@mistake("uncommon/times-of-frames", "a query reads the bucket of its time and not the neighbours")
def neighbours_missing():
    def buckets(h, level, begin, end):
        at = lambda t: times.bucket_of_phase(times.phase_of_time(h, times.clamp_time(h, t)), level)
        return at(begin), at(end)
    decoder.buckets_of_query = buckets


@mistake("uncommon/times-of-frames", "times are not snapped to frames")
def no_snap():
    def phase(h, t):
        frames = (t - h["time_begin"]) * float(h["fps_num"]) / float(h["fps_den"])
        return min(max(int(frames / h["num_frames"] * 2.0 ** 40), 0), times.LAST_PHASE)
    times.phase_of_time = phase


@mistake("core/encoder-room-default", "a page is left out at the ends of its visible interval")
def open_intervals():
    def may_be_visible(h, layer, record, begin, end):
        first, last = times.visible_interval(h, layer["level"], record)
        return layer["permanent"] or (times.clamp_time(h, end) > first and times.clamp_time(h, begin) < last)
    decoder.may_be_visible = may_be_visible


@mistake("core/mean-raw64", "times of queries count from 0 and not from time_begin")
def time_base():
    before = times.clamp_time
    times.clamp_time = lambda h, t: before(h, t - h["time_begin"])


@mistake("core/mean-none", "Gaussians come finest layer first")
def order_of_gaussians():
    before = decoder.Decoder.select
    decoder.Decoder.select = lambda self, query: sorted(before(self, query), key=lambda s: -s.index)


@mistake("core/tiny", "b03 of a rotor has the wrong sign")
def sign_of_rotor():
    before = rotor.rotor_of
    rotor.rotor_of = lambda a, b: [-v if i == 4 else v for i, v in enumerate(before(a, b))]


@mistake("core/sh-degree-1", "SH rows are colour by colour and not coefficient by coefficient")
def order_of_sh():
    before = reconstruct.attributes

    def attributes(*arguments):
        out = before(*arguments)
        out["sh"] = [[v for c in range(3) for v in row[c::3]] for row in out["sh"]]
        return out
    decoder.attributes = attributes


@mistake("faulty/CHNK-5-checksum", "the checksum of a zstd frame is not looked at")
def frame_checksum_ignored():
    zstd.xxh64 = lambda data: EQUAL


class Equal(int):
    def __and__(self, other):
        return self

    def __eq__(self, other):
        return True

    __hash__ = int.__hash__


EQUAL = Equal(0)


@mistake("faulty/CHNK-2", "the hash of a chunk is not looked at")
def chunk_hash_ignored():
    file.File.chunk.__globals__["xxh3_64"] = lambda data: EQUAL


@mistake("faulty/HEAD-9", "the rules of the scene header are not looked at")
def header_rules_ignored():
    decoder.check_header = lambda *_, **__: None


@mistake("faulty/CHNK-4", "chunks may overlap")
def overlaps_allowed():
    directory.Taken.take = lambda self, begin, size, what: None


@mistake("core/opacity-clamped", "opacities are not kept within 0 and 1")
def opacity_not_clamped():
    reconstruct.opacities = lambda p: reconstruct.scalars(p.header["opacity"], p.opacity, p.n)


@mistake("core/mean-fixed-fine", "refinements of mean times are not used")
def refinement_ignored():
    reconstruct.part_of_step = lambda fine: 0.0


@mistake("core/mean-f16-shift-7", "left-out bits of a mean time are taken for zeros")
def middle_of_the_cell():
    replaced_in_modules(page.ordered_mean_time, lambda code, shift: code << shift, page, reconstruct)


@mistake("core/base-two-layers", "pages of a block use the codebook of the layer")
def block_codebooks_ignored():
    before = codebooks.Codebooks.of_block

    def of_block(self, layer, block):
        of_layer = lambda c, n: (list(self.codebook(layer, c, 0)) * n)[:n]
        return {c: of_layer(c, len(rows)) for c, rows in before(self, layer, block).items()}
    codebooks.Codebooks.of_block = of_block


@mistake("core/rans-transform", "base detail leaves out all of SH")
def base_without_coefficients():
    before = reconstruct.vectors

    def vectors(p, c, books, block):
        rows = before(p, c, books, block)
        left_out = c == header.SH and not p.has_sh
        return [list(books.codebook(p.index, c, codebooks.BASIS)[0])] * len(rows) if left_out else rows
    reconstruct.vectors = vectors


@mistake("core/window", "coded begins of windows count from the first frame")
def windows_from_the_first_frame():
    page.window_base = lambda h, level, bucket: 0


@mistake("core/window", "the mean time of a window is its begin")
def mean_time_at_the_begin():
    before = reconstruct.window_middle
    reconstruct.window_middle = lambda h, window: before(h, (window[0], window[0]))


@mistake("uncommon/windows-of-24-bits", "the high bits of lengths of windows are left out")
def high_bits_of_lengths():
    before = page.Page.windows
    page.Page.windows = lambda self: [(a, a + (b - a & 0xFFFF)) for a, b in before(self)]


@mistake("limits/level-3-memory-beyond", "block codebooks do not count as memory")
def memory_of_blocks():
    before = levels.Demand.layer

    def layer(self, *arguments):
        before(self, *arguments)
        self.chunks = [c if c[2] else (*c[:4], 0) for c in self.chunks]
    levels.Demand.layer = layer


@mistake("limits/level-1-tables-of-empty-layers-beyond", "entropy chunks of layers without Gaussians are no tables")
def tables_of_empty_layers():
    before = levels.Demand.tables

    def tables(self):
        before(self)
        self.table_bytes -= sum(1 << 19 for la in self.h["layers"] if la["entropy"] and not la["num_gaussians"])
    levels.Demand.tables = tables


@mistake("faulty/DIR-5-instant-few", "sums of Gaussians are compared in queries of everything alone")
def sums_of_instants_ignored():
    before = directory.Directory.pages

    def pages(self, index, first=0, last=None):
        whole = before(self, index, first, last)
        try:
            yield from whole
        except arithmetic.Invalid as broken:
            if last is None or broken.clause != "DIR-5":
                raise
    directory.Directory.pages = pages


@mistake("uncommon/minor-version", "other minor versions are refused")
def minor_version_refused():
    before = file.File.scene_header

    def scene_header(self):
        chunk = before(self)
        arithmetic.require(self.data[9] == 0, "FILE-2", "minor version", 9)
        return chunk
    file.File.scene_header = scene_header


@mistake("uncommon/minor-version", "extensions that are not critical are refused")
def extensions_refused():
    before = decoder.check_header

    def check(h, *more):
        arithmetic.require(not h["extensions"], "HEAD-8", "an extension")
        before(h, *more)
    decoder.check_header = check


@mistake("faulty/CHNK-1-file-bytes", "a stream is taken to reach to the end of its file")
def end_of_file():
    file.File.limit = lambda *_: None


def main(arguments):
    if arguments[:1] == ["--list"]:
        for name, (vector, about, _) in MISTAKES.items():
            print(f"{name:<28} {vector:<32} {about}")
        return 0
    if not arguments or arguments[0] not in ("none", *MISTAKES):
        print(__doc__, file=sys.stderr)
        return 2
    if arguments[0] != "none":
        MISTAKES[arguments[0]][2]()
    return l4d.main(arguments[1:])


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

# SPDX-License-Identifier: Apache-2.0
"""A valid stream with transforms, fixed positions and both forms of pages, and streams that break
one rule of these each, their checksums repaired."""

import copy
import struct

import stream_builder as sb     # its import makes the following ones possible
import decode_tiny
import random_page
import rans_writer
from broken_streams import FIRST
from legal import Window
from make_tiny import order
from rans_writer import Channel, vlq
from rng import Rng
from xxh3 import xxh3_64

NO_BOUNDS = (0xFBFF,) * 3 + (0x7BFF,) * 3
WIDE, HYBRID = rans_writer.fitted([1] * 126), rans_writer.fitted([1] * 112)
N = 33


class Parts:
    """What the stream is made of: one layer with two pages, the first of streams and the second of
    channels. An edit changes parts before they are put together."""

    def __init__(self):
        def transform(*eob_table):
            return {"coding": 3, "steps": [0.5, 0.25, 0.125], "eob_table": list(eob_table),
                    "basis": [(0.0, 0.5, -0.25), (1.0, 0.0, 0.0), (0.0, 1.0, 0.5),
                              (0.25, 0.0, 1.0)]}
        self.layer = {
            "level": 0, "permanent": False, "mean_t": 2, "mean_t_shift": 2, "log_scale_t": 0.0,
            "num_gaussians": 2 * N, "directory_bits": 0, "table_size": 1, "blocks": {},
            "scale_factor": {"coding": 0, "bits": 0, "offset": -4.0, "step": 0.0},
            "scale": {"coding": 2, "escapes": True, "stages": [[(0.0, 0.25, 0.5, 0.0)] * 3] * 2},
            "rotor_spatial": transform(1, 3), "rotor_temporal": transform(3)}
        self.scene = {
            "num_gaussians": 2 * N, "time_begin": 1.0, "num_frames": 2, "fps_num": 4, "fps_den": 1,
            "origin": {}, "position": 3, "position_bits": 8, "position_center": {},
            "position_scale": 0.0625, "sh_degree": 0, "sh": transform(1, 2), "sh_base": 1,
            "opacity": {"coding": 2, "bits": 5, "offset": 0.0, "step": 0.03125}}
        self.scene["sh"].update(steps=[1.0, 0.5], basis=self.scene["sh"]["basis"][:3])
        self.draw()
        self.split, self.tables, self.num_wide, self.num_tables = True, [WIDE, HYBRID], 1, None
        self.records, self.table_bytes, self.end = [{}, {}], {}, {}
        self.file = {}                    # of the file: options of build()
        self.page_bytes = self.detail_bytes = self.chunk_bytes = lambda raw: raw

    def draw(self):
        """Columns of the codings as they are now."""
        self.columns = []
        scene, layer = copy.deepcopy((self.scene, self.layer))
        for seed in range(2):
            c = random_page.Columns(Rng(seed), scene, layer, N, Window(scene, layer["level"]), {})
            c.rng = FIRST                 # packed streams
            self.columns.append(c)
        self.channels = self.columns[1].channels()
        self.map = [[0 if p.wide else 1] * p.num_contexts for p in self.channels]

    def find(self, name):
        return next(i for i, p in enumerate(self.channels) if p.name == name)

    def put(self, name, value, i=0):
        """Value i of a channel."""
        at = self.find(name)
        old = self.channels[at]
        values = old.values[:i] + [value] + old.values[i + 1:]
        self.channels[at] = Channel(name, values, old.contexts, old.num_contexts, old.wide)

    def build(self):
        chunk = vlq(len(self.tables) if self.num_tables is None else self.num_tables)
        chunk += vlq(self.num_wide)
        for i, frequencies in enumerate(self.tables):
            chunk += self.table_bytes.get(i, rans_writer.table(frequencies))
        chunk += b"".join(map(bytes, self.map))
        used = [[WIDE if p.wide else HYBRID] * p.num_contexts for p in self.channels]
        split = rans_writer.first_detail(self.channels, self.scene["sh_base"])
        raw, detail = rans_writer.page(self.channels, used, split if self.split else None, **self.end)
        record = {"num_gaussians": N, "bucket": 0, "block": sb.NO_BLOCK, "visible_begin": 0,
                  "visible_end": 255, "bounds": NO_BOUNDS, "reserved": 0}
        pages = [{**record, "raw": self.columns[0].streams(), **self.records[0]},
                 {**record, "codec": 2, "raw": self.page_bytes(raw),
                  "detail": self.detail_bytes(detail), **self.records[1]}]
        layer = dict({"entropy": self.chunk_bytes(chunk)}, **self.layer)
        return sb.build(dict(self.scene, layers=[dict(layer, pages=pages)]), rng=FIRST, **self.file)


def edited(*edits):
    parts = Parts()
    for edit in edits:
        edit(parts)
    return parts.build()


def layer(**fields):
    return edited(lambda p: p.layer.update(fields))


def header(**fields):
    return edited(lambda p: p.scene.update(fields))


def coding(name, **fields):
    return edited(lambda p: (p.scene if name == "sh" else p.layer)[name].update(fields))


def channel(name, value, i=0):
    return edited(lambda p: p.put(name, value, i))


def frequencies(table, values, num_tokens=None):
    """Its bytes, which may be no valid table."""
    return edited(lambda p: p.table_bytes.update(
        {table: rans_writer.table(values, num_tokens)}))


def parts(**fields):
    return edited(lambda p: vars(p).update(fields))


def mapped(name, table):
    return edited(lambda p: p.map.__setitem__(p.find(name), [table] * len(p.map[p.find(name)])))


def column(component, key, value):
    """A value of the page of streams."""
    return edited(lambda p: p.columns[0].component[component][key].__setitem__(0, value))


def planes_layout(p, name, key, value, width):
    """The values of a stream of the first page as byte planes, with room for more than width."""
    c = p.columns[0].component[name]
    old = sb.stream(FIRST, c[key], width)
    raw = p.columns[0].streams()
    c[key][0] = value
    new = b"\x01\x00" + bytes(c[key])
    p.records[0]["raw"] = raw.replace(old, new, 1)


def half_positions(p):
    p.scene.update(position=2)
    p.draw()


FIXED_MEAN_TIMES = {"mean_t": 3, "mean_t_bits": 9, "mean_t_zero": 256, "mean_t_step": 0.001,
                    "mean_t_fine": False}


def fixed_mean_times(**fields):
    def edit(p):
        p.layer.update(FIXED_MEAN_TIMES, **fields)
        p.draw()
    return edit


def infinite_position(p):
    code = random_page.morton(*[order(float("inf"))] * 3)
    p.put("position", code - sum(p.channels[0].values[:-1]), N - 1)


def raw(name):
    def edit(p):
        (p.scene if name in p.scene else p.layer)[name] = 1 if name == "position" else {
            "coding": 1, "bits": 0, "offset": 0.0, "step": 0.0}
        p.scene["sh_base"] = 0
        p.draw()
    return edited(edit)


def directory_codec(codec):
    """Of the directory page."""
    data = bytearray(Parts().build())
    file, _ = decode_tiny.decode(bytes(data))
    at = next(begin for begin, _, text in file.claims
              if text == "page table of layer 0, entry 0: codec = 0")
    data[at] = codec
    data[at + 4:at + 8] = (xxh3_64(bytes(data[at - 24:at + 4])) & 0xFFFFFFFF).to_bytes(4, "little")
    return bytes(data)


def bounded(bits, most):
    """Fixed positions that do not move, and bounds from 0 to `most`."""
    def edit(p):
        p.scene.update(position_bits=bits)
        p.layer["rotor_temporal"] = {"coding": 0}
        p.draw()
        for r in p.records:
            r["bounds"] = struct.unpack("<6H", struct.pack("<6e", 0, 0, 0, most, most, most))
    return edited(edit)


def valid():
    """Some streams that break no rule."""
    yield "as it is", Parts().build()
    yield "one part", parts(split=False)
    yield "no base", header(sh_base=0)
    yield "all of sh in the base", header(sh_base=2)
    yield "fixed mean times", edited(fixed_mean_times())
    yield "refined mean times", edited(fixed_mean_times(mean_t_fine=True))
    yield "bounds of 8 bits", bounded(8, 255)
    yield "bounds of 15 bits", bounded(15, 32768)
    yield "bounds of 21 bits", bounded(21, 32768)


def broken_headers():
    """(clause, file); a second word tells cases of it apart."""
    vq = {"coding": 2, "escapes": False, "stages": [[(1.0, 0.0, 0.0, 0.0)]]}
    basis = Parts().scene["sh"]["basis"]
    yield "HEAD-7 position unknown", header(position=6)
    yield "HEAD-16 raw64", header(position=4)
    yield "HEAD-7 mean_t unknown", layer(mean_t=6)
    yield "HEAD-7 basis element", coding("sh", patch={"element": 2})
    yield "HEAD-14 scale coded", layer(scale_factor={"coding": 1})
    yield "HEAD-15 temporal", layer(rotor_spatial=vq)
    yield "HEAD-15 spatial zero", layer(rotor_spatial={"coding": 0})
    yield "HEAD-15 spatial", layer(rotor_temporal=vq)
    yield "CODE-5", header(position_bits=0)
    yield "CODE-5 many", header(position_bits=22)
    yield "CODE-6", layer(mean_t_shift=11)
    yield "TIME-1", layer(**dict(FIXED_MEAN_TIMES, mean_t_bits=0))
    yield "TIME-1 many", layer(**dict(FIXED_MEAN_TIMES, mean_t_bits=17))
    yield "TIME-2", layer(**dict(FIXED_MEAN_TIMES, mean_t_step=0.0))
    yield "TIME-2 negative", layer(**dict(FIXED_MEAN_TIMES, mean_t_step=-0.125))
    yield "TIME-2 NaN", layer(**dict(FIXED_MEAN_TIMES, mean_t_step=float("nan")))
    yield "TIME-2 large", layer(**dict(FIXED_MEAN_TIMES, mean_t_step=2.0 ** 61))
    yield "TRAN-8", coding("sh", patch={"element": 1, "step": 1.0})
    yield "TRAN-8 rotor", coding("rotor_spatial", patch={"element": 1, "step": 2.0 ** -10})
    yield "TRAN-1", coding("sh", steps=[], eob_table=[], basis=basis[:1])
    yield "TRAN-1 many", coding("sh", steps=[1.0] * 4, eob_table=[4], basis=basis + basis[:2])
    yield "TRAN-1 rotor", coding("rotor_spatial", steps=[1.0] * 4, eob_table=[4],
                                 basis=[(0.0, 0.0, 0.0)] * 5)
    yield "TRAN-2", coding("sh", steps=[1.0, 2.0 ** -21])
    yield "TRAN-2 large", coding("sh", steps=[1025.0, 1.0])
    yield "TRAN-2 negative", coding("sh", steps=[-1.0, 1.0])
    yield "TRAN-2 rotor", coding("rotor_spatial", steps=[1.0, 1.0, 1.0 + 2.0 ** -23])
    yield "TRAN-2 temporal", coding("rotor_temporal", steps=[2.0, 1.0, 1.0])
    yield "TRAN-2 NaN", coding("sh", steps=[float("nan"), 1.0])
    yield "TRAN-3", coding("sh", eob_table=[1, 1, 2])
    yield "TRAN-3 zero", coding("sh", eob_table=[0, 2])
    yield "TRAN-3 last", coding("sh", eob_table=[1])
    yield "TRAN-3 beyond", coding("sh", eob_table=[1, 2, 3])
    yield "TRAN-3 none", coding("sh", eob_table=[])
    yield "TRAN-4", coding("sh", basis=[])
    yield "TRAN-4 few", coding("sh", patch={"num_entries": 2})
    yield "TRAN-4 many", coding("sh", patch={"num_entries": 4})
    yield "TRAN-7", header(sh_base=3)
    yield "TRAN-7 vq", edited(lambda p: p.scene.update(sh={
        "coding": 2, "escapes": False, "stages": [[(1.0, 0.0, 0.0)]]}), lambda p: p.draw())


def broken_chunks():
    inf = float("inf")
    yield "CODE-4 basis", coding("sh", basis=[(inf, 0.0, 0.0)] * 3)
    yield "CHNK-7 basis", coding("sh", suffix=b"\x00")
    yield "CHNK-8 basis", coding("sh", suffix=bytes(3 * 38))
    yield "CHNK-6 rans codebook", edited(lambda p: p.layer.update(entropy_patch={"codec": 2}))
    yield "CHNK-7 entropy", parts(chunk_bytes=lambda raw: raw + b"\x00")
    yield "CHNK-8 entropy", parts(chunk_bytes=lambda raw: raw + bytes(67000))
    yield "CHNK-2 entropy", layer(entropy_patch={"hash": 1})
    yield "CHNK-3 rans", parts(records=[{}, {"patch": {"raw_bytes": 5}}])
    yield "CHNK-6 rans channel", edited(lambda p: p.records[0].update(
        raw=b"\x01\x02" + p.columns[0].streams()[2:]))
    yield "CHNK-6 rans directory", directory_codec(2)
    yield "RANS-1 vlq", parts(chunk_bytes=lambda raw: b"\xff" * 9 + raw)
    yield "RANS-1 map", parts(chunk_bytes=lambda raw: raw[:-1])
    yield "RANS-1 table", parts(chunk_bytes=lambda raw: raw[:20])
    yield "RANS-1 nothing", parts(chunk_bytes=lambda raw: b"")
    yield "RANS-2", frequencies(1, [1023])
    yield "RANS-2 sum", frequencies(1, [1023, 2])
    yield "RANS-2 huge", frequencies(1, [1, (1 << 62) - 1])
    yield "RANS-2 none", frequencies(1, [], 0)
    yield "RANS-2 hybrid", frequencies(1, [0] * 112 + [1024])
    yield "RANS-2 wide", frequencies(0, [0] * 126 + [1024])
    yield "RANS-2 last", frequencies(1, [1024, 0])
    yield "RANS-2 beyond", frequencies(1, [1024, 0, 0, 0], 3)
    yield "RANS-4 wide", mapped("opacity", 0)
    yield "RANS-4 hybrid", mapped("position", 1)
    yield "RANS-4 beyond", mapped("sh step exponent", 2)
    yield "RANS-5", parts(num_tables=0)
    yield "RANS-5 many", edited(lambda p: p.tables.extend([HYBRID] * 127))
    yield "RANS-5 no wide", parts(num_wide=0)
    yield "RANS-5 wide", parts(num_wide=3)


def broken_pages():
    first = lambda change: parts(page_bytes=change)
    second = lambda change: parts(detail_bytes=change)
    record = lambda **patch: parts(records=[{}, {"patch": patch}])
    state = (0x1234).to_bytes(4, "little")
    low = [rans_writer.LOW] * 32
    yield "RANS-1 first", first(lambda raw: raw[:127])
    yield "RANS-1 nothing in it", first(lambda raw: b"")
    yield "RANS-1 second", second(lambda raw: raw[:127])
    yield "RANS-1 all", parts(split=False, page_bytes=lambda raw: raw[:127])
    yield "RANS-3", first(lambda raw: state + raw[4:])
    yield "RANS-3 second", second(lambda raw: raw[:124] + state + raw[128:])
    yield "CHNK-1 second", record(sh_offset=1 << 20)
    yield "CHNK-2 second", record(sh_hash=1)
    yield "CHNK-8 second", second(lambda raw: raw + bytes(20000))
    yield "DIR-13", parts(split=False, records=[{}, {"patch": {"sh_offset": 1}}])
    yield "DIR-13 hash", parts(split=False, records=[{}, {"patch": {"sh_hash": 1}}])
    yield "FILE-7 detail", parts(file={"flags": 5, "streamable": lambda what, found: found[::-1]})
    yield "DIR-13 streams", parts(records=[{"detail": bytes(128)}, {}])
    yield "DIR-13 zstd", parts(records=[{"detail": bytes(128), "codec": 1}, {}])
    yield "DIR-13 base", edited(lambda p: p.scene.update(sh_base=2), lambda p: p.records[1].update(
        detail=bytes(128)))
    for name in ("position", "opacity", "sh", "scale"):
        yield "RANS-6 " + name, raw(name)
    yield "RANS-6 entropy", layer(entropy=None)
    yield "RANS-7 first", first(lambda raw: raw + bytes(2))
    yield "RANS-7", parts(end={"words": b"\x00\x00"})
    yield "RANS-7 odd", parts(end={"words": b"\x00"})
    yield "RANS-7 missing", parts(split=False, page_bytes=lambda raw: raw[:-2])
    yield "RANS-7 state", parts(end={"states": low[:31] + [rans_writer.LOW + 1]})
    yield "RANS-7 all", parts(split=False, end={"states": [rans_writer.LOW + 1] + low[:31]})
    yield "RANS-8", channel("position", 1 << 24, 0)
    yield "RANS-8 sum", channel("position", (1 << 24) - 1, N - 1)
    yield "RANS-8 wrap", edited(lambda p: p.put("position", (1 << 63) - 1, N - 2),
                                lambda p: p.put("position", (1 << 63) - 1, N - 1))
    yield "RANS-8 f16", edited(half_positions, lambda p: p.put("position", 1 << 48, 0))
    yield "TRAN-5", channel("sh step exponent", 16)
    yield "TRAN-5 rotor", channel("rotor_temporal step exponent", 65535, N - 1)
    yield "TRAN-6", channel("sh EOB index", 3)
    yield "TRAN-6 stream", column("sh", "eob_index", 3)
    yield "VQ-1 channel", channel("scale depth", 3)
    yield "VQ-2 channel", channel("scale index", 3)
    yield "VAL-1 channel", channel("mean_t", 0x3FFF)
    yield "VAL-1 mean_t", edited(lambda p: p.columns[0].mean_t.__setitem__(0, 0x3FFF))
    yield "VAL-1 position", edited(half_positions, infinite_position)
    yield "VAL-2 channel", channel("scale escape", order(float("inf")))
    yield "STRM-3 opacity", channel("opacity", 32)
    yield "STRM-3 mean_t", channel("mean_t", 1 << 14)
    yield "STRM-3 mean_t fixed", edited(fixed_mean_times(), lambda p: p.put("mean_t", 1 << 9))
    yield "STRM-3 position", edited(lambda p: p.columns[0].position[0].__setitem__(0, 256))
    yield "STRM-3 step exponent", edited(lambda p: planes_layout(p, "sh", "step_exponent", 16, 4))
    yield "DIR-10 fixed", bounded(8, 254)
    yield "DIR-10 scaled", bounded(21, 32752)
    yield "PAGE-1 transform", edited(lambda p: p.records[0].update(
        raw=p.columns[0].streams() + b"\x00"))


def broken():
    yield from broken_headers()
    yield from broken_chunks()
    yield from broken_pages()

# SPDX-License-Identifier: Apache-2.0
"""A valid stream, and streams that break one rule each, their checksums repaired."""

import copy

import stream_builder as sb     # its import makes the following ones possible
import decode_tiny
import make_tiny
from xxh3 import xxh3_64


MEAN_TIMES = (21, 28)       # where three mean times are in a page of the second layer
WINDOWS = (21, 25)          # and three windows


def scene():
    """A valid stream of two layers with every kind of column, which breaks no rule at all."""
    halves = lambda values: make_tiny.packed([make_tiny.order(v) for v in values], 16)
    box = (0xCC00,) * 3 + (0x4C00,) * 3
    record = {"bounds": box, "reserved": 0}
    vq = lambda *stages, escapes=False, **more: {"coding": 2, "stages": list(stages),
                                                  "escapes": escapes, **more}
    sq = {"coding": 2, "bits": 5, "offset": 0.0, "step": 0.03125}
    factor = {"coding": 0, "bits": 0, "offset": -4.0, "step": 0.0}
    codebook4 = [(0.0, 0.25, 0.5, 0.0), (0.0, 0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)]
    spatial = [(1.0, 0.0, 0.0, 0.0), (0.5, 0.5, 0.0, 0.0)]
    sh = make_tiny.packed([1, 2, 15], 4) + make_tiny.packed([0, 1], 1) + make_tiny.packed([1], 1)
    sh += b"".join(halves([v]) for v in (0.5, 0.25, 0.125))
    head = b"".join([halves([1.0, 2.0, 3.0])] * 3)
    opacity = make_tiny.packed([0, 5, 31], 5)
    zero_mean = halves([0.0, 0.0, 0.0])
    layers = [
        {"level": 0, "permanent": True, "mean_t": 0, "num_gaussians": 3, "log_scale_t": 4.0,
         "scale_factor": factor, "scale": vq([r[:3] for r in codebook4]), "rotor_spatial": vq(spatial),
         "rotor_temporal": {"coding": 0}, "directory_bits": 0, "table_size": 1, "blocks": {},
         "pages": [{"num_gaussians": 3, "bucket": 0, "block": sb.NO_BLOCK, "visible_begin": 0,
                    "visible_end": 255, **record, "raw": head + opacity + sh +
                    make_tiny.packed([0, 1, 2], 2) + make_tiny.packed([0, 1, 0], 1)}]},
        {"level": 1, "permanent": False, "mean_t": 2, "num_gaussians": 6, "log_scale_t": 0.0,
         "scale_factor": factor,
         "scale": vq(codebook4, rcq=[(0.0, 0.0, 0.0, -0.25), (0.0, 0.0, 0.0, 0.0)]),
         "rotor_spatial": vq(spatial), "rotor_temporal": {"coding": 0}, "directory_bits": 1,
         "table_size": 2, "blocks": {0: [[(1, 2, sb.rcq_table(FIRST, [(0, 0), (1, 1)], 3, 2))]]},
         "pages": [{"num_gaussians": 3, "bucket": 1, "block": 0, "visible_begin": 80,
                    "visible_end": 176, **record, "raw": head + zero_mean + opacity + sh +
                    make_tiny.packed([0, 1, 1], 1) + make_tiny.packed([0, 1, 0], 1)},
                   {"num_gaussians": 3, "bucket": 2, "block": sb.NO_BLOCK, "visible_begin": 80,
                    "visible_end": 176, **record, "raw": head + zero_mean + opacity + sh +
                    make_tiny.packed([0, 1, 1], 2) + make_tiny.packed([0, 1, 0], 1)}]}]
    return {"num_gaussians": 9, "time_begin": 1.0, "num_frames": 2, "fps_num": 4, "fps_den": 1,
            "origin": {}, "position": 2, "position_center": {}, "position_scale": 1.0,
            "opacity": sq, "sh_degree": 0, "layers": layers,
            "sh": vq([(0.5, 0.0, 0.0), (0.0, 1.0, 0.0)], [(0.1, 0.0, 0.0)] * 2, escapes=True)}


class First:
    """Stands in for Rng where streams shall have one form: packed, no gaps."""

    random = staticmethod(lambda: 0.5)
    randrange = staticmethod(lambda n: 0)
    randbytes = staticmethod(bytes)
    shuffle = staticmethod(lambda items: None)


FIRST = First()


def windows(begins, bits=2, lengths=(0, 0, 0)):
    """The streams of three windows of one frame, and more."""
    return make_tiny.packed(begins, bits) + make_tiny.packed(lengths, 1)


def flat_scene():
    """The same with windows in place of mean times: of frame 0 in bucket 1, of frame 1 in bucket 2."""
    s = scene()
    la = s["layers"][1]
    la.update(mean_t=5, window_begin_bits=2, window_length_bits=1, window_length=1)
    for page, begins, times in zip(la["pages"], ([0, 0, 0], [1, 1, 1]), ((32, 160), (95, 224))):
        begin, end = MEAN_TIMES
        page["raw"] = page["raw"][:begin] + windows(begins) + page["raw"][end:]
        page.update(visible_begin=times[0], visible_end=times[1])
    return s


def flat_edited(edit):
    s = flat_scene()
    edit(s["layers"][1])
    return sb.build(s, rng=FIRST)


def window_page(page, columns):
    def edit(la):
        begin, end = WINDOWS
        raw = la["pages"][page]["raw"]
        la["pages"][page]["raw"] = raw[:begin] + columns + raw[end:]
    return flat_edited(edit)


def broken_windows():
    flat = flat_scene()
    yield "WIND-1 begin", flat_edited(lambda la: la.update(window_begin_bits=25))
    yield "WIND-1 length", flat_edited(lambda la: la.update(window_length_bits=25))
    yield "WIND-1 least", flat_edited(lambda la: la.update(window_length=(1 << 24) + 1))
    yield "WIND-2", sb.build({**flat, "time_begin": 2.0 ** 39}, rng=FIRST)
    yield "WIND-3 late", window_page(1, windows([1, 1, 1], lengths=[0, 1, 0]))
    yield "WIND-3 empty", flat_edited(lambda la: la.update(window_length=0))
    yield "WIND-3 beyond", window_page(1, windows([1, 3, 1]))
    yield "STRM-3 window", window_page(0, b"\x02\x04" + windows([0, 0, 0])[2:])
    yield "HEAD-16 window", sb.build({**flat, "position": 5}, rng=FIRST)
    yield "LAYR-3", window_page(0, windows([0, 1, 0]))
    yield "DIR-9 window", flat_edited(lambda la: la["pages"][1].update(visible_begin=97))
    yield "DIR-9 window end", flat_edited(lambda la: la["pages"][0].update(visible_end=159))


AT_THE_MIDDLE, NEAR_THE_END = 1.25, 1.4375
# Broken streams of which an instant reads enough to refuse them. Near the end, it reads one of the two directory pages
# of the second layer.
OF_INSTANTS = {"DIR-5 instant": AT_THE_MIDDLE, "DIR-5 instant few": AT_THE_MIDDLE, "DIR-5 instant level 1": AT_THE_MIDDLE,
               "DIR-5 instant level 1 few": AT_THE_MIDDLE, "DIR-5 instant one page": NEAR_THE_END}


def broken_sums():
    """Numbers of Gaussians that the layers do not have: they have 3 and 6."""
    stated = lambda *numbers: edited(lambda s: (s.update(num_gaussians=sum(numbers)), *(
        la.update(num_gaussians=n) for la, n in zip(s["layers"], numbers))))
    yield "DIR-5", stated(3, 7)
    yield "DIR-5 many", stated(3, 5)
    yield "DIR-5 instant", stated(2, 6)
    yield "DIR-5 instant few", stated(4, 6)
    yield "DIR-5 instant level 1", stated(3, 5)
    yield "DIR-5 instant level 1 few", stated(3, 7)
    yield "DIR-5 instant one page", stated(3, 2)


def raw_mean_times(s, value):
    """Mean times of binary64 in the second layer, whose first is `value`."""
    la, (begin, end) = s["layers"][1], MEAN_TIMES
    la["mean_t"] = 4
    for page, values in zip(la["pages"], ([value, 1.0, 1.0], [1.0] * 3)):
        coded = [sb.order64(v) for v in values]
        columns = make_tiny.packed([v >> 32 for v in coded], 32) + make_tiny.packed([v & 0xFFFFFFFF for v in coded], 32)
        page["raw"] = page["raw"][:begin] + columns + page["raw"][end:]


def broken_numbers():
    """Rules of which other streams break one part."""
    infinite = float("inf")
    camera = {"position": [0, 0, infinite], "target": [0, 0, 0], "up": [0, 1, 0], "fov": 1.0}
    yield "FILE-5 bytes", header_edited(lambda d, b, e: d.__setitem__(slice(12, 16), bytes(4)))
    yield "HEAD-3 log scale", edited(lambda s: s["layers"][0].update(log_scale_t=infinite))
    yield "HEAD-3 step", coding(None, "opacity", step=2.0 ** -61)
    yield "HEAD-20 camera", edited(lambda s: s.update(presentation={"camera": camera}))
    yield "VAL-3 mean time", edited(lambda s: raw_mean_times(s, 2.0 ** 61))


def edited(edit):
    s = copy.deepcopy(scene())
    edit(s)
    return sb.build(s, rng=FIRST)


def header_edited(edit):
    """An edit of the scene header's bytes, or of the file header's, with checksums repaired."""
    data = bytearray(sb.build(scene(), rng=FIRST))
    n = int.from_bytes(data[12:16], "little")
    edit(data, 40, 40 + n)
    return rehashed(data)


def rehashed(data):
    """With right hashes of the scene header and the file header."""
    data = bytearray(data)
    n = int.from_bytes(data[12:16], "little")
    data[24:32] = xxh3_64(data[40:40 + n]).to_bytes(8, "little")
    data[32:40] = xxh3_64(data[:32]).to_bytes(8, "little")
    return bytes(data)


def put(data, at, value):
    data[at] = value


def page_edit(layer, page, old, new):
    """Replaces bytes of a page; `old` is bytes or a (begin, end)."""
    def edit(s):
        p = s["layers"][layer]["pages"][page]
        begin, end = old if isinstance(old, tuple) else (p["raw"].index(old),) * 2
        end += len(old) * isinstance(old, bytes)
        p["raw"] = p["raw"][:begin] + new + p["raw"][end:]
    return edited(edit)


def record(layer, page, **patch):
    return edited(lambda s: s["layers"][layer]["pages"][page].update(patch=patch))


def layer(index, **fields):
    return edited(lambda s: s["layers"][index].update(fields))


def coding(index, name, **fields):
    return edited(lambda s: (s if index is None else s["layers"][index])[name].update(fields))


def tables(*entries):
    return edited(lambda s: s["layers"][1]["blocks"].update({0: [list(entries)]}))


def share_strings():
    """Every pair of a list refers to the first one's table."""
    s = scene()
    s["metadata"] = [{"key": "a", "value": "x" * 4000}] + [{"key": "b", "value": ""}] * 40
    data = bytearray(sb.build(s, rng=FIRST))
    file, _ = decode_tiny.decode(bytes(data))
    vector = next(begin for begin, _, text in file.claims if text == "Header.metadata: 41 elements")
    first = vector + 4 + int.from_bytes(data[vector + 4:vector + 8], "little")
    for i in range(1, 41):
        at = vector + 4 + 4 * i
        data[at:at + 4] = (first - at).to_bytes(4, "little")
    n = int.from_bytes(data[12:16], "little")
    data[24:32] = xxh3_64(data[40:40 + n]).to_bytes(8, "little")
    data[32:40] = xxh3_64(data[:32]).to_bytes(8, "little")
    return bytes(data)


def vtable_edited(table, at, value):
    """The u16 at a place of the vtable of a table of the scene header."""
    file, _ = decode_tiny.decode(sb.build(scene(), rng=FIRST))
    begin = next(b for b, _, text in file.claims if text.startswith(f"vtable of {table}:"))
    return header_edited(lambda d, b, e: d.__setitem__(slice(begin + at, begin + at + 2),
                                                       value.to_bytes(2, "little")))


def with_metadata(value):
    """A value of the metadata that stands where a text of its length was."""
    text = "unlike any other: " + "?" * len(value)
    s = scene()
    s["metadata"] = [{"key": "key", "value": text}]
    data = sb.build(s, rng=FIRST)
    end = data.index(text.encode()) + len(text)
    return rehashed(data[:end - len(value)] + value + data[end:])


def flipped(find, repair=False):
    """One bit of the first byte whose annotation contains a text."""
    data = bytearray(sb.build(scene(), rng=FIRST))
    file, _ = decode_tiny.decode(bytes(data))
    data[next(begin for begin, _, text in sorted(file.claims) if find in text)] ^= 1
    return bytes(data)


STREAMABLE = 5              # flags: a draft in the streamable layout


def streamable(order):
    """Layers of level 0 with the tiers 0 and 1, and the layer of level 1."""
    s = scene()
    s["layers"].insert(1, dict(copy.deepcopy(s["layers"][0]), tier=1))
    s["num_gaussians"] += s["layers"][1]["num_gaussians"]
    return sb.build(s, flags=STREAMABLE, rng=FIRST, streamable=order)


def broken():
    """(clause, file) of streams that break one rule each; a second word tells cases of it apart."""
    inf = float("inf")
    whole = sb.build(scene(), rng=FIRST)
    rcq = scene()["layers"][1]["scale"]["rcq"]
    pairs = lambda *p: sb.rcq_table(FIRST, p, 4, 2)
    yield "FILE-1 short", whole[:39]
    yield "FILE-1 magic", b"\x88" + whole[1:]
    yield "FILE-2", header_edited(lambda d, b, e: put(d, 8, 2))
    yield "FILE-3", header_edited(lambda d, b, e: put(d, 11, 1))
    yield "FILE-4", whole[:9] + b"\x01" + whole[10:]
    yield "FILE-5", header_edited(lambda d, b, e: put(d, 16, 39))
    yield "FILE-6", flipped("Header.num_gaussians =")
    yield "FILE-7", sb.build(scene(), flags=STREAMABLE, rng=FIRST)
    for part in ("pages", "directory"):
        yield f"FILE-7 {part}", streamable(lambda what, parts, part=part: parts[::-1] if what == part else parts)
    yield "FILE-7 tier", streamable(lambda what, parts: parts[1::-1] + parts[2:] if what == "pages" else parts)
    yield "HEAD-1", header_edited(lambda d, b, e: put(d, b + 4, 0x6C))
    yield "HEAD-2", edited(lambda s: s.update(num_frames=0))
    yield "HEAD-3", edited(lambda s: s.update(position_scale=2.0 ** -61))
    yield "HEAD-4", edited(lambda s: s.update(sh_degree=4))
    yield "HEAD-5", edited(lambda s: s.update(num_gaussians=10))
    yield "HEAD-6 level", layer(1, level=2)
    yield "HEAD-6 many", edited(lambda s: s["layers"].extend([dict(
        s["layers"][1], num_gaussians=0, pages=[], blocks={})] * 9))
    yield "HEAD-6 none", edited(lambda s: s.update(layers=[], num_gaussians=0, sh={"coding": 0}))
    yield "HEAD-16 position", edited(lambda s: s.update(position=0))
    for bad in (b"\xff", b"\xc0\x80", b"\xed\xa0\x80", b"\xe2\x82"):
        yield f"HEAD-17 {bad.hex()}", with_metadata(bad)
    nan = float("nan")
    for field, value in (("position", -1.0), ("opacity", nan), ("covariance", 0.5),
                         ("visible_bound", inf), ("base_color", -0.5), ("directional_color_bound", nan)):
        yield f"HEAD-18 {field}", edited(lambda s: s.update(errors={field: value}))
    for field, value in (("dilation", -0.1), ("dilation", 16.5), ("cutoff", 0.5), ("cutoff", nan),
                         ("min_alpha", 0.001), ("max_alpha", 1.0), ("max_alpha", nan)):
        yield f"HEAD-19 {field} {value}", edited(lambda s: s.update(rendering={field: value}))
    camera = {"position": [0, 0, 4], "target": [0, 0, 0], "up": [0, 1, 0], "fov": 1.0}
    box = {"min": [-1, -1, -1], "max": [1, 1, 1]}
    for name, value in (("metres", {"metres_per_unit": -1.0}), ("metres inf", {"metres_per_unit": inf}),
                        ("bounds", {"bounds": dict(box, max=[1, -2, 1])}),
                        ("bounds nan", {"bounds": dict(box, min=[nan, 0, 0])}),
                        ("up", {"camera": dict(camera, up=[0, 0, 1])}),
                        ("fov", {"camera": dict(camera, fov=3.0)}),
                        ("target", {"camera": dict(camera, target=camera["position"])})):
        yield f"HEAD-20 {name}", edited(lambda s: s.update(presentation=value))
    # Of the vtable of opacity: its size, that of the table, the place of the first field.
    for at, value in ((0, 0), (0, 2), (2, 0), (2, 4), (2, 0xFFFE), (4, 2)):
        yield f"HEAD-1 vtable {at} {value}", vtable_edited("Header.opacity", at, value)
    yield "HEAD-7 scalar", coding(None, "opacity", coding=3)
    yield "HEAD-7 component", coding(0, "scale", coding=4)
    yield "HEAD-7 element", coding(0, "scale", patch={"element": 2})
    yield "HEAD-8", edited(lambda s: s.update(extensions=[{"id": 7, "critical": True}]))
    yield "HEAD-9", edited(lambda s: s.update(gate=16.5))
    yield "HEAD-10", layer(0, mean_t=2)
    yield "HEAD-11", layer(0, rotor_temporal={"coding": 1})
    yield "HEAD-12 bits", layer(1, directory_bits=17)
    yield "HEAD-12 many", edited(lambda s: (s.update(num_frames=1 << 24), s["layers"][1].update(
        level=24, directory_bits=4)))
    yield "HEAD-13", share_strings()
    yield "HEAD-14", coding(0, "scale_factor", coding=1)
    yield "CODE-1", coding(None, "opacity", bits=17)
    yield "CODE-2", coding(0, "scale", patch={"num_entries": 0})
    yield "CODE-2 residual", coding(1, "scale", rcq=rcq * 2049)
    yield "CODE-3", coding(0, "scale", stages=[])
    yield "CODE-7", coding(0, "scale", patch={"element": 1, "step": 0.0})
    yield "CODE-7 large", coding(0, "scale", patch={"element": 1, "step": 1025.0})
    yield "CODE-7 NaN", coding(0, "scale", patch={"element": 1, "step": float("nan")})
    yield "CODE-4", coding(0, "scale", stages=[[(inf, 0.0, 0.0)] * 3])
    yield "RCQ-1", tables((1, 2, pairs((3, 0), (1, 1))))
    yield "RCQ-2", coding(0, "scale", rcq=[(0.0, 0.0, 0.0)])
    yield "RCQ-3", tables((2, 2, pairs((0, 0), (1, 1))))
    yield "RCQ-3 sh", tables((0, 2, pairs((0, 0), (1, 1))))
    yield "RCQ-4", tables((1, 0, pairs((0, 0), (1, 1))))
    yield "RCQ-5", tables(*[(1, 2, pairs((0, 0), (1, 1)))] * 2)
    yield "CHNK-1", record(0, 0, offset=len(whole))
    yield "CHNK-1 size", record(0, 0, stored_bytes=0xFFFFFFFF, raw_bytes=0xFFFFFFFF)
    yield "CHNK-1 wrap", record(0, 0, offset=(1 << 64) - 1)
    yield "CHNK-2", flipped("rotor_spatial index")
    yield "CHNK-3", record(0, 0, raw_bytes=100)
    yield "CHNK-4", edited(lambda s: s["layers"][1]["pages"].append(s["layers"][1]["pages"][1]) or
                           overlap(s))
    yield "CHNK-5", record(0, 0, codec=1)
    yield "CHNK-6", record(0, 0, codec=9)
    yield "CHNK-6 channel", page_edit(0, 0, (0, 7), b"\x01\x09")
    yield "CHNK-7", coding(0, "scale", suffix=b"\x00")
    yield "CHNK-8", page_edit(0, 0, (0, 0), bytes(8000))
    yield "STRM-1", page_edit(0, 0, (0, 1), b"\x08")
    yield "STRM-1 layout", page_edit(0, 0, (0, 1), b"\x03")
    yield "STRM-2", edited(lambda s: s["layers"][0]["pages"][0].update(
        raw=s["layers"][0]["pages"][0]["raw"][:-1]))
    yield "STRM-2 vlq", page_edit(0, 0, (0, 7), b"\x01\x01" + b"\xff" * 9)
    yield "STRM-3", page_edit(0, 0, make_tiny.packed([0, 5, 31], 5), b"\x01\x00\x00\x05\x20")
    yield "STRM-4", page_edit(0, 0, make_tiny.packed([0, 5, 31], 5), b"\x00\xa0\xfc")
    yield "STRM-6", page_edit(0, 0, (0, 7), b"\x06\x00\x80")
    yield "STRM-6 width", page_edit(0, 0, make_tiny.packed([0, 5, 31], 5), b"\x04\xa0\x7c")
    yield "DIR-1", flipped("entry_hash")
    yield "DIR-2", layer(1, patch={"index": 1})
    yield "DIR-2 layer", layer(1, patch={"layer": 0})
    yield "DIR-3", record(1, 0, bucket=2)
    yield "DIR-4", record(1, 0, num_gaussians=0)
    yield "DIR-6", record(0, 0, block=0)
    yield "DIR-7", record(1, 0, visible_begin=177)
    yield "DIR-8", edited(lambda s: s["layers"][1]["pages"].insert(
        1, dict(s["layers"][1]["pages"][0], block=sb.NO_BLOCK)))
    yield "DIR-9", record(1, 0, visible_begin=126)
    yield "DIR-10", record(0, 0, bounds=(0xCC00,) * 3 + (0x3C00,) * 3)
    yield "DIR-11", edited(lambda s: s["layers"][1]["blocks"][0].extend([[]] * 256))
    yield "DIR-12", record(0, 0, bounds=(0x4C00,) * 3 + (0x3C00,) * 3)
    yield "PAGE-1", edited(lambda s: s["layers"][0]["pages"][0].update(
        raw=s["layers"][0]["pages"][0]["raw"] + b"\x00"))
    yield "VQ-1", page_edit(0, 0, make_tiny.packed([1, 2, 15], 4), make_tiny.packed([1, 3, 15], 4))
    yield "VQ-2", page_edit(0, 0, make_tiny.packed([0, 1, 2], 2), make_tiny.packed([0, 1, 3], 2))
    yield "VAL-1", page_edit(0, 0, (1, 3), make_tiny.order(inf).to_bytes(2, "little"))
    yield "VAL-2", page_edit(0, 0, make_tiny.packed([make_tiny.order(0.25)], 16),
                             make_tiny.packed([make_tiny.order(inf)], 16))
    yield "VAL-3", edited(raw_position)
    yield "VAL-4 opacity", edited(lambda s: raw_opacities(s, 1.0 + 2.0 ** -23))
    yield "VAL-4 negative", edited(lambda s: raw_opacities(s, -2.0 ** -149))
    yield "VAL-4 log scale", edited(lambda s: raw_scales(s, -17.0 - 2.0 ** -19))
    yield "LAYR-1", coding(1, "scale_factor", offset=-2.0)
    yield from broken_windows()
    yield from broken_numbers()
    yield from broken_sums()


def overlap(s):
    """A record more after the last of the last layer, which names the bytes of another page."""
    s["layers"][1]["num_gaussians"] += 3
    s["num_gaussians"] += 3
    s["layers"][1]["pages"][-1] = dict(s["layers"][1]["pages"][-1], patch={"offset": 0})
    # The first page of the payload is the permanent layer's; its hash has to fit.
    first = s["layers"][0]["pages"][0]["raw"]
    s["layers"][1]["pages"][-1]["patch"].update(hash=xxh3_64(first), stored_bytes=len(first),
                                               raw_bytes=len(first))


def raw_opacities(s, value):
    """Raw opacities in all pages, one of which is the value."""
    s["opacity"] = {"coding": 1}
    raw = make_tiny.packed([sb.order32(v) for v in (0.0, value, 1.0)], 32)
    for la in s["layers"]:
        for p in la["pages"]:
            p["raw"] = p["raw"].replace(make_tiny.packed([0, 5, 31], 5), raw, 1)


def raw_scales(s, value):
    """Raw log scales in the first layer, one of which is the value."""
    s["layers"][0]["scale"] = {"coding": 1}
    raw = make_tiny.packed([sb.order32(v) for v in (17.0, value, -17.0)], 32)
    p = s["layers"][0]["pages"][0]
    p["raw"] = p["raw"].replace(make_tiny.packed([0, 1, 2], 2), raw * 3, 1)


def raw_position(s):
    s["position"] = 1
    for la in s["layers"]:
        for p in la["pages"]:
            raw = make_tiny.packed([sb.order32(v) for v in (1.0, 2.0, 3.0)], 32)
            p["raw"] = raw * 3 + p["raw"][21:]
    p = s["layers"][0]["pages"][0]
    p["raw"] = p["raw"][:1] + sb.order32(float("inf")).to_bytes(4, "little") + p["raw"][5:]

# SPDX-License-Identifier: Apache-2.0
"""Streams that declare a profile or a level and break one rule of section 18 each, and no other."""

import copy

import stream_builder as sb     # its import makes the following ones possible
import broken_rans
import broken_streams
import make_tiny
import rans_writer
from broken_streams import FIRST

NO_BOUNDS = broken_rans.NO_BOUNDS
ZERO = {"coding": 0}
CONSTANT = {"coding": 0, "bits": 0, "offset": -8.0, "step": 0.0}
HALF_ZERO = 0x8000              # 0.0 as an ordered binary16


def zeros(count, mode=make_tiny.constant):
    return mode(HALF_ZERO, 16) * count


def packed_zeros(n):
    return b"\x00" + HALF_ZERO.to_bytes(2, "little") * n


def page(n, *columns, **record):
    return {"num_gaussians": n, "bucket": 0, "block": sb.NO_BLOCK, "visible_begin": 0,
            "visible_end": 255, "bounds": NO_BOUNDS, "reserved": 0,
            "raw": zeros(3) + b"".join(columns), **record}


def layer(pages, level=0, **fields):
    """Positions at 0, opacities, scales and rotors constant."""
    return {"level": level, "permanent": level == 0, "mean_t": 0 if level == 0 else 2,
            "num_gaussians": sum(p["num_gaussians"] for p in pages), "log_scale_t": 0.0,
            "scale_factor": CONSTANT, "scale": ZERO, "rotor_spatial": ZERO, "rotor_temporal": ZERO,
            "directory_bits": level + (level > 0), "table_size": 1, "blocks": {}, "pages": pages,
            **fields}


def stream(layers, sh=ZERO, frames=4, level=1, **fields):
    return sb.build({
        "num_gaussians": sum(la["num_gaussians"] for la in layers), "time_begin": 1.0,
        "num_frames": frames, "fps_num": frames, "fps_den": 1, "origin": {}, "position": 2,
        "position_center": {}, "position_scale": 1.0, "opacity": CONSTANT, "sh_degree": 3,
        "sh": sh, "layers": layers, "profile": 1, "conformance_level": level, **fields}, rng=FIRST)


def codebooks(stages):
    """SH codebooks of 65536 equal codewords each."""
    return {"coding": 2, "escapes": False, "stages": [[(0.0,) * 48]] * stages,
            "patch": {"num_entries": 65536}}


def escape_page(n, *columns, **record):
    """Pages whose SH vectors are all escapes: 96 bytes a Gaussian."""
    return page(n, *columns, make_tiny.constant(15, 4), packed_zeros(n) * 48, **record)


ESCAPES = {"coding": 2, "escapes": True, "stages": [[(0.0,) * 48]]}


def gaussians(n):
    return stream([layer([page(65536), page(n - 65536)])])


def tables(stages):
    columns = [make_tiny.constant(stages, 4)] * (stages > 1) + [zeros(1)] * stages
    return stream([layer([page(1, *columns)])], sh=codebooks(stages))


def instant(n):
    return stream([layer([escape_page(n)])], sh=ESCAPES)


def start(n):
    return stream([layer([page(1)])], metadata=[{"key": "text", "value": "x" * n}])


def burst(n):
    """Two pages of a bucket, needed a sixteenth of a second apart and for less than that."""
    at = lambda time: make_tiny.constant(make_tiny.order(time), 16)
    pages = [escape_page(n, at(0.0), bucket=2, visible_begin=126, visible_end=130),
             escape_page(n, at(0.25), bucket=2, visible_begin=142, visible_end=146)]
    return stream([layer(pages, level=1)], sh=ESCAPES)


def block_layers(num_layers):
    """Layers with three block codebooks of 3 MiB around the middle of the sequence."""
    layers = []
    row = (1.0, 0.0, 0.0, 0.0)
    coding = {"coding": 2, "escapes": False, "stages": [[row] * 2], "rcq": [row] * 2}
    entry = make_tiny.constant(0, 1) * 2
    for k in range(num_layers):
        level = 1 + k // 6
        pages = [page(1, zeros(1), *[make_tiny.constant(0, 16)] * 3, block=b,
                      bucket=(1 << level) - 2 + b) for b in range(3)]
        blocks = [[(c, 65536, entry) for c in (1, 2, 3)] for _ in range(3)]
        layers.append(layer(pages, level, blocks={0: blocks}, scale=coding, rotor_spatial=coding,
                            rotor_temporal=coding,
                            scale_factor={**CONSTANT, "offset": -8.0 - max(level - 4, 0)}))
    return layers


def memory(num_layers):
    return stream(block_layers(num_layers), frames=16)


MOST_SYMBOLS = 240


def layers_of_symbols(count, columns=(), level=0, **record):
    """Layers whose pages have `count` symbols together, by what they declare. Their pages have none."""
    count = int(count)
    wide, hybrid = rans_writer.fitted([1] * 126), rans_writer.fitted([1] * 112)
    maps = [[0], *[[1]] * len(columns)]
    entropy = rans_writer.entropy_chunk([wide, hybrid], 1, maps)
    layers = []
    for each, n in ((MOST_SYMBOLS, count // MOST_SYMBOLS), (count % MOST_SYMBOLS, 1)):
        sizes = [65536] * (n // 65536) + [n % 65536] * (n % 65536 > 0)
        layers += [layer([page(size, *columns, **record) for size in sizes], level, entropy=entropy,
                         symbols_per_gaussian=each)] * (each > 0 and n > 0)
    return layers


def symbol_burst_layers(early, late):
    """Pages of one bucket, needed a sixteenth of a second apart and for less than that."""
    at = lambda time: [make_tiny.constant(make_tiny.order(time), 16)]
    return [*layers_of_symbols(early, at(0.0), 1, bucket=2, visible_begin=126, visible_end=130),
            *layers_of_symbols(late, at(0.25), 1, bucket=2, visible_begin=142, visible_end=146)]


def declared(profile, level, edit=lambda s: None):
    s = copy.deepcopy(broken_streams.scene())
    s.update(profile=profile, conformance_level=level)
    edit(s)
    return sb.build(s, rng=FIRST)


def transform(profile):
    return broken_rans.header(profile=profile)


def valid():
    for profile in range(3):
        yield f"profile {profile}", declared(profile, profile)
    yield "transform", transform(2)
    yield "symbols", broken_rans.layer(symbols_per_gaussian=16)
    yield "Gaussians", gaussians(100000)
    yield "tables", tables(2)
    yield "burst", burst(5000)
    yield "memory", memory(6)
    yield "two levels up", stream([layer([page(65536), page(65536)])], level=2)


def broken():
    """(clause, file); a second word tells cases of it apart."""
    yield "LEVL-1", declared(4, 0)
    yield "LEVL-1 level", declared(0, 7)
    yield "LEVL-2 indexed", transform(1)
    yield "LEVL-2 lossless", declared(3, 0)
    yield "LEVL-2 main", declared(2, 0, lambda s: s["layers"][0].update(
        rotor_spatial={"coding": 1}, pages=[dict(s["layers"][0]["pages"][0], raw=s["layers"][0][
            "pages"][0]["raw"][:-2] + make_tiny.packed([sb.order32(0.5)] * 3, 32) * 4)]))
    yield "LEVL-3", gaussians(100001)
    yield "LEVL-4", tables(3)
    yield "LEVL-5", instant(45000)
    yield "LEVL-6", start(8 << 20)
    yield "LEVL-7", burst(32768)
    yield "LEVL-8", memory(8)
    yield "LEVL-10", stream(layers_of_symbols(6400001))
    yield "LEVL-11", stream(symbol_burst_layers(6400000, 6400000))
    yield "LEVL-9", broken_rans.layer(symbols_per_gaussian=15)

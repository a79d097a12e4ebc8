# SPDX-License-Identifier: Apache-2.0
"""Streams at each limit of each conformance level (section 18.2), and beyond it by the least there is: a byte, a
Gaussian, or a number of a codebook. Those at a limit keep every other limit too; those beyond break one rule.

Streams at a limit of stored bytes are as large as the limit: 4 MiB at level 1, 512 MiB at level 6."""

import functools

import broken_levels as bl
import frames
import levels
import stream_builder as sb
from arithmetic import Invalid
from catalogue import Vector
from decoder import Decoder

MOST_ENTRIES, MOST_STAGES, MOST_PAGE = 65536, 8, 65536
MANY_FRAMES = 1 << 22               # allow 94 layers
ENTROPY_BYTES = 1 << 19             # of C, for each layer with an entropy chunk
LOSSLESS_FACTOR = 8                 # of I, H, R and B
COMPONENTS = ("scale", "rotor_spatial", "rotor_temporal")        # 4 numbers each
# Streams here consist of equal pages and codebooks, whose hashes would take most of the time.
sb.xxh3_64 = functools.lru_cache(64)(sb.xxh3_64)


def stream(level, layers, **fields):
    return bl.stream(layers, frames=MANY_FRAMES, level=level, **fields)


# ---- what fills a limit --------------------------------------------------------------------------

def framed(raw, size):
    """The bytes as a zstd frame of `size` bytes: blocks of no bytes fill it."""
    blocks = [raw[at:at + frames.MOST_BLOCK] for at in range(0, len(raw), frames.MOST_BLOCK)]
    least = 6 + len(raw) + 3 * len(blocks)
    # Widths of the content size, which differ modulo 3.
    code, width = next((c, w) for c, w in ((0, 0), (2, 4), (3, 8)) if (size - least - w) % 3 == 0)
    return (frames.MAGIC + bytes([code << 6, 0x58]) + len(raw).to_bytes(8, "little")[:width] +
            frames.block(0, b"") * ((size - least - width) // 3) +
            b"".join(frames.block(0, b) for b in blocks[:-1]) + frames.block(0, blocks[-1], last=True))


def pages_of(size, *columns, **record):
    """Pages of `size` stored bytes together, of vectors of SH that no codebook has."""
    whole = bl.escape_page(MOST_PAGE, *columns, **record)
    out = [whole] * ((size - 1000) // len(whole["raw"]))
    rest = size - sum(len(p["raw"]) for p in out)
    last = bl.escape_page((rest - 500) // 97, *columns, **record)
    framed_raw = framed(last["raw"], rest)
    return [*out, {**last, "raw": framed_raw, "patch": {"codec": 1, "raw_bytes": len(last["raw"])}}]


def constants(n):
    """A layer of n Gaussians in a few bytes."""
    sizes = [MOST_PAGE] * (n // MOST_PAGE) + [n % MOST_PAGE] * (n % MOST_PAGE > 0)
    return bl.layer([bl.page(size) for size in sizes])


class Entries(list):
    """The rows of a codebook of n equal rows."""

    def __init__(self, n, dim=4):
        super().__init__([(0.0,) * dim])
        self.n = n

    def __len__(self):
        return self.n


def table_layers(size):
    """Layers without Gaussians whose codebooks take `size` bytes, a multiple of 4 and at least 256, decoded."""
    left, layers = size, []
    while left >= 256 + 16:
        codings = {}
        for name in COMPONENTS:
            stages = []
            while len(stages) < MOST_STAGES and left >= 256 + 16:
                stages.append(Entries(min(MOST_ENTRIES, (left - 256) // 16)))
                left -= 16 * stages[-1].n
            codings[name] = coded(stages) if stages else bl.ZERO
        layers.append(bl.layer([], permanent=False, mean_t=2, **codings))
    of_scale = 3 * left // 4 % 4 or 4                   # scales of permanent layers have 12 bytes
    layers.append(bl.layer([], scale=coded([Entries(of_scale, 3)]),
                           rotor_spatial=coded([Entries((left - 12 * of_scale) // 16)])))
    return layers


def coded(stages):
    return {"coding": 2, "escapes": False, "stages": stages}


def stored_layers(size):
    """Layers whose codebooks take about `size` bytes in the file."""
    left, layers = size, []
    while left >= 128:
        codings = {}
        for name in COMPONENTS:
            n = min(MOST_ENTRIES, left // (8 * MOST_STAGES) - 1)
            codings[name] = bl.ZERO if n < 1 else {**coded([[]] * MOST_STAGES), "suffix": bl.packed_zeros(n) * 4,
                                                   "patch": {"num_entries": n}}
            left -= MOST_STAGES * 4 * (1 + 2 * n) if n > 0 else 0
        layers.append(bl.layer([], permanent=False, mean_t=2, **codings))
    return layers


# ---- one stream for each limit -------------------------------------------------------------------

def exact(build, first, target, measure):
    """build(p) for the p that makes it `target`: one more of p is one more of what is measured."""
    p = first + target - measure(levels.demand(Decoder(build(first))))
    data = build(p)
    found = measure(levels.demand(Decoder(data)))
    if found != target:
        raise ValueError(f"{found} instead of {target}")
    return data


def of_gaussians(level, most, beyond):
    return stream(level, [constants(most + beyond)])


def of_tables(level, most, beyond):
    return stream(level, [*table_layers(most + 4 * beyond), bl.layer([bl.page(1)])])


def of_instant(level, most, beyond):
    return stream(level, [bl.layer(pages_of(most + beyond))], sh=bl.ESCAPES)


def of_start(level, most, beyond):
    instant, target = levels.LEVELS[level][2], most + beyond
    measure = lambda d: d.start_bytes
    build = lambda stored, pages: stream(level, [*stored_layers(stored), bl.layer(pages_of(pages))], sh=bl.ESCAPES)
    stored = target - instant
    for _ in range(2):                  # the header grows with the layers
        stored += target - measure(levels.demand(Decoder(build(stored, instant)))) + 100
    return exact(lambda pages: build(stored, pages), instant, target, measure)


def of_burst(level, most, beyond):
    """Pages of one bucket, needed a sixteenth of a second apart and for less than that."""
    rate = levels.LEVELS[level][4]
    at = lambda time: bl.make_tiny.constant(bl.make_tiny.order(time), 16)
    early = pages_of(most // 2 + rate // 16, at(0.0), bucket=2, visible_begin=126, visible_end=130)
    build = lambda late: stream(level, [bl.layer([*early, *pages_of(
        late, at(0.25), bucket=2, visible_begin=142, visible_end=146)], level=1)], sh=bl.ESCAPES)
    return exact(build, most // 2, most + beyond, lambda d: d.burst(rate))


def of_memory(level, most, beyond):
    gaussians, tables = levels.LEVELS[level][:2]
    blocks = max(0, -(-(most - 260 * gaussians - tables) // (3 * 12 * 4 * MOST_ENTRIES)))
    build = lambda size: stream(level, [*table_layers(size), constants(gaussians - 3 * blocks), *bl.block_layers(blocks)])
    return exact(build, tables // 2, most + 4 * beyond, lambda d: d.memory_bytes)


def of_symbols(level, most, beyond):
    return stream(level, bl.layers_of_symbols(most + beyond))


def of_symbol_burst(level, most, beyond, *others):
    rate = levels.LEVELS[level][8]
    build = lambda late: stream(level, [*bl.symbol_burst_layers(most // 2 + rate // 16, late), *others])
    return exact(build, most // 2, most + beyond, lambda d: d.burst(rate, d.later_symbols))


# ---- layers without Gaussians: their entropy chunks are tables, and they have no symbols -----------

def empty_layer(level=0):
    """A layer that declares the most symbols for each of its Gaussians."""
    of_symbols = bl.layers_of_symbols(1)[0]
    return bl.layer([], level, entropy=of_symbols["entropy"], symbols_per_gaussian=255)


def of_empty_tables(level, most, beyond):
    number = most // ENTROPY_BYTES - 1
    rest = most - number * ENTROPY_BYTES + 4 * beyond
    return stream(level, [bl.layer([bl.page(1)]), *[empty_layer()] * number, *table_layers(rest)])


def of_empty_symbols(level, most, beyond):
    return stream(level, [*bl.layers_of_symbols(most + beyond), empty_layer()])


def of_empty_symbol_burst(level, most, beyond):
    return of_symbol_burst(level, most, beyond, empty_layer(1))


# ---- streams of the profile lossless that declare none -------------------------------------------

def lossless(level, pages, temporal_level):
    raw = {"coding": 1}
    return stream(level, [bl.layer(pages, temporal_level, permanent=False, mean_t=1, **dict.fromkeys(COMPONENTS, raw))],
                  sh=raw, sh_degree=0, position=1, opacity=dict(raw, bits=0, offset=0.0, step=0.0), profile=0)


def lossless_page(size, seconds, **record):
    """A page of one Gaussian and `size` stored bytes."""
    numbers = [0.0] * 3 + [seconds, 0.5] + [0.0] * 3 + [-8.0] * 4 + [1.0] + [0.0] * 7
    raw = b"".join(bl.make_tiny.packed([sb.order32(x)], 32) for x in numbers)
    return {**bl.page(1, **record), "raw": framed(raw, size), "patch": {"codec": 1, "raw_bytes": len(raw)}}


def of_lossless_instant(level, most, beyond):
    return lossless(level, [lossless_page(LOSSLESS_FACTOR * most + beyond, 1.5)], 0)


def of_lossless_burst(level, most, beyond):
    """As of_burst."""
    rate, most = LOSSLESS_FACTOR * levels.LEVELS[level][4], LOSSLESS_FACTOR * most
    early = lossless_page(most // 2 + rate // 16, 1.625, bucket=2, visible_begin=126, visible_end=130)
    build = lambda late: lossless(level, [early, lossless_page(
        late, 1.6875, bucket=2, visible_begin=142, visible_end=146)], 1)
    return exact(build, most // 2, most + beyond, lambda d: d.burst(rate))


# Limits of section 18.2 in the order of levels.LEVELS. R is a part of that of B, W of that of S.
LIMITS = {"gaussians": (0, "LEVL-3", of_gaussians), "tables": (1, "LEVL-4", of_tables),
          "instant": (2, "LEVL-5", of_instant), "start": (3, "LEVL-6", of_start), "burst": (5, "LEVL-7", of_burst),
          "memory": (6, "LEVL-8", of_memory), "symbols": (7, "LEVL-10", of_symbols),
          "symbol-burst": (7, "LEVL-11", of_symbol_burst)}
OF_MANY_BYTES = {"instant", "start", "burst"}
# What counts is the same at all levels, so level 1 alone has these.
OF_EMPTY_LAYERS = {"tables-of-empty-layers": (1, "LEVL-4", of_empty_tables),
                   "symbols-and-an-empty-layer": (7, "LEVL-10", of_empty_symbols),
                   "symbol-burst-and-an-empty-layer": (7, "LEVL-11", of_empty_symbol_burst)}
OF_LOSSLESS = {"lossless-instant": (2, "LEVL-5", of_lossless_instant),
               "lossless-burst": (5, "LEVL-7", of_lossless_burst)}


def vectors(chosen, validated):
    """Two for each limit of the chosen levels. validated: levels at which the query `validate` is asked too."""
    for level in chosen:
        yield from of_level(level, validated, {**LIMITS, **(OF_LOSSLESS if level == 1 else {})})


def of_level(level, validated, limits):
    for name, (column, clause, build) in limits.items():
        for beyond in (0, 1):
            word = "beyond" if beyond else "at"
            yield Vector("limits", f"level-{level}-{name}-{word}", f"{word} the limit of level {level}: {name}",
                         build(level, levels.LEVELS[level][column], beyond), [clause],
                         f"limits.py, level {level}", beyond=beyond, validated=level in validated)


def small():
    """Those that take few bytes. Readers without fast paths take long to validate the larger ones."""
    few = {name: limit for name, limit in LIMITS.items() if name not in OF_MANY_BYTES}
    for level in levels.LEVELS:
        yield from of_level(level, {1}, {**few, **(OF_EMPTY_LAYERS if level == 1 else {})})


def broken_rule(data):
    """Of those about levels."""
    try:
        levels.check(Decoder(data))
    except Invalid as broken:
        return broken.clause
    return None

# SPDX-License-Identifier: Apache-2.0
"""Writes rANS blocks, entropy chunks and rANS pages, as sections 9.1, 10.2 and 13.2 of spec/l4d.md
have them read."""

import struct

from stream_builder import vlq

LANES = 32
SLOTS = 1024
LOW = 1 << 16


def hybrid_token(value):
    """(token, [(bits, raw)])"""
    if value < 16:
        return value, []
    e = value.bit_length() - 5            # value = (8 + m) 2^(e+1) + raw
    m = (value >> e + 1) - 8
    return 16 + 8 * e + m, [(e + 1, value & (1 << e + 1) - 1)]


def wide_token(value):
    if value < 2:
        return value, []
    bits = value.bit_length() - 2         # value = (2 + m) 2^bits + raw
    pieces, raw = [], value & (1 << bits) - 1
    for at in range(0, bits, 16):
        size = min(16, bits - at)
        pieces.append((size, raw >> at & (1 << size) - 1))
    return 2 * (bits + 1) + (value >> bits & 1), pieces


class Channel:
    """values, and for each the number of its context."""

    def __init__(self, name, values, contexts=None, num_contexts=1, wide=False):
        self.name, self.values, self.wide = name, values, wide
        self.contexts = contexts or [0] * len(values)
        self.num_contexts = num_contexts
        self.tokens = [(wide_token if wide else hybrid_token)(v) for v in values]


def block(channels, maps, states=None, words=b""):
    """maps: for each channel the frequencies of each of its contexts. states: those at the end, and
    words after it, where they shall be wrong."""
    steps = []                            # (lane, (frequency, begin) or (bits, raw)) as read
    for channel, tables in zip(channels, maps):
        for group in range(0, len(channel.tokens), LANES):
            part = list(zip(channel.tokens, channel.contexts))[group:group + LANES]
            for lane, ((token, _), context) in enumerate(part):
                f = tables[context]
                steps.append((lane, True, f[token], sum(f[:token])))
            for piece in range(max(len(pieces) for (_, pieces), _ in part)):
                steps += [(lane, False, *pieces[piece])
                          for lane, ((_, pieces), _) in enumerate(part) if piece < len(pieces)]
    x, out = list(states or [LOW] * LANES), []
    for lane, is_token, a, b in reversed(steps):
        if x[lane] >= (a << 22 if is_token else 1 << 32 - a):
            out.append(x[lane] & 0xFFFF)
            x[lane] >>= 16
        x[lane] = (x[lane] // a << 10) + x[lane] % a + b if is_token else x[lane] << a | b
    return struct.pack(f"<{LANES}I{len(out)}H", *x, *reversed(out)) + words


def first_detail(channels, sh_base):
    """Number of the first channel of SH detail."""
    of = "sh coefficient" if sh_base else "sh "
    found = [i for i, p in enumerate(channels) if p.name.startswith(of)]
    return [*found, *[len(channels)] * (sh_base + 1)][sh_base]


def page(channels, maps, split, **end):
    """The parts. split: number of the first channel of the second, None for one part. end: of the last
    block."""
    if split is None or split == len(channels):
        return block(channels, maps, **end), b""
    return block(channels[:split], maps[:split]), block(channels[split:], maps[split:], **end)


def table(frequencies, num_tokens=None, spare=lambda: 0):
    """The bytes of a table; its last frequency is not 0."""
    out = vlq(len(frequencies) if num_tokens is None else num_tokens, spare())
    i = 0
    while i < len(frequencies):
        out += vlq(frequencies[i], spare())
        i += 1
        if frequencies[i - 1] == 0:
            zeros = 0
            while i + zeros < len(frequencies) and frequencies[i + zeros] == 0:
                zeros += 1
            out += vlq(zeros, spare())
            i += zeros
    return out


def entropy_chunk(tables, num_wide, maps, spare=lambda: 0):
    """maps: for each channel the numbers of tables of its contexts."""
    out = vlq(len(tables), spare()) + vlq(num_wide, spare())
    return out + b"".join(table(t, spare=spare) for t in tables) + b"".join(map(bytes, maps))


def fitted(counts):
    """Frequencies of 1024 in sum, about as counts are, with at least 1 where a count is not 0."""
    used = [t for t, c in enumerate(counts) if c] or [0]
    total = sum(counts[t] for t in used) or 1
    f = [0] * (used[-1] + 1)
    for t in used:
        f[t] = 1 + (SLOTS - len(used)) * counts[t] // total
    largest = max(used, key=lambda t: f[t])
    f[largest] += SLOTS - sum(f)
    return f


class Model:
    """Tables for all pages of a layer, and which of them each context has: at random.

    pages: for each page its channels; all have the same names in the same order."""

    def __init__(self, rng, names, pages):
        num_wide, num_hybrid = rng.choice([1, 1, 2, 5]), rng.choice([0, 1, 2, 7, 40, 123])
        if len(names) > 1:
            num_hybrid = max(num_hybrid, 1)
        choose = lambda wide: (rng.randrange(num_wide) if wide else
                               num_wide + rng.randrange(num_hybrid))
        self.map = [[choose(wide) for _ in range(contexts)] for _, contexts, wide in names]
        counts = [[0] * (126 if t < num_wide else 112) for t in range(num_wide + num_hybrid)]
        for channels in pages:
            for channel, used in zip(channels, self.map):
                for (token, _), context in zip(channel.tokens, channel.contexts):
                    counts[used[context]][token] += 1
        for c in counts:                  # tokens that nothing uses; tables of all tokens
            for _ in range(rng.choice([0, 0, 3, len(c)])):
                c[rng.randrange(len(c))] += rng.randrange(2)
        self.tables, self.num_wide = [fitted(c) for c in counts], num_wide
        spare = lambda: rng.randrange(40) == 0
        self.chunk = entropy_chunk(self.tables, num_wide, self.map, spare=spare)

    def page(self, channels, split):
        return page(channels, [[self.tables[t] for t in used] for used in self.map], split)

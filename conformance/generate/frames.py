# SPDX-License-Identifier: Apache-2.0
"""Writes zstd frames, RFC 8878, with blocks of every kind: raw, RLE, and compressed ones whose literals are
raw, RLE or coded by Huffman, and whose sequences use predefined tables or RLE tables."""

from xxh64 import xxh64
from zstd import LITERAL, MATCH, OFFSET, Fse

MAGIC = (0xFD2FB528).to_bytes(4, "little")
MOST_BLOCK = 1 << 17


def frame_header(rng, size, checksum):
    """In one of the forms that can hold the size. The window has 2^17 bytes or more."""
    single = rng.random() < 0.5
    widths = [0 if not single else 1, 2, 4, 8]
    fits = [k for k, w in enumerate(widths) if
            (w == 0 or 256 * (w == 2) <= size < (1 << 8 * w) + 256 * (w == 2))]
    code = rng.choice(fits)
    out = MAGIC + bytes([code << 6 | single << 5 | checksum << 2])
    if not single:
        out += bytes([rng.choice([7 << 3, 10 << 3 | 5, 16 << 3])])      # 2^17, 1.625 * 2^20, 2^26
    width = widths[code]
    return out + (size - 256 * (width == 2)).to_bytes(width, "little") if width else out


def block(kind, data, size=None, last=False):
    return (last | kind << 1 | (len(data) if size is None else size) << 3).to_bytes(3, "little") + data


def frame(rng, data, checksum=None, header=None):
    """A frame of the data; rng chooses its blocks."""
    checksum = rng.random() < 0.5 if checksum is None else checksum
    out = frame_header(rng, len(data), checksum) if header is None else header
    single = out[4] & 0x20
    most = min(len(data), MOST_BLOCK) if single else MOST_BLOCK
    at, seen, recent = 0, {}, [1, 4, 8]
    while True:
        size = min(len(data) - at, most, rng.choice([most, most, 1, 7, 100, 1000]))
        part, last = data[at:at + size], at + size == len(data) and rng.random() < 0.9
        if size > 0 and part == part[:1] * size and rng.random() < 0.8:
            out += block(1, part[:1], size, last)
        else:
            packed = compressed(rng, data, at, size, seen, recent) if size > 3 and rng.random() < 0.7 else None
            fits = packed is not None and len(packed) < most
            out += block(2, packed, last=last) if fits else block(0, part, last=last)
        at += size
        if last:
            break
    return out + (xxh64(data) & 0xFFFFFFFF).to_bytes(4, "little") * checksum


# ---- compressed blocks ---------------------------------------------------------------------------

def compressed(rng, data, at, size, seen, recent):
    """The content of a compressed block, or None where Huffman codes of it would be too long. `recent` are
    the three last offsets; it changes where there are sequences."""
    trial = list(recent)
    sequences, literals = parse(data, at, size, seen, trial)
    head = literals_section(rng, literals)
    recent[:] = trial
    if not sequences:
        return head + b"\0"
    count = len(sequences)
    out = head + (bytes([count]) if count < 128 else
                  bytes([128 + (count >> 8), count & 255]) if count < 0x7F00 else
                  b"\xff" + (count - 0x7F00).to_bytes(2, "little"))
    codes = [[code_of(kind[0], s[k]) for s in sequences]
             for k, kind in enumerate((LITERAL, OFFSET, MATCH))]
    modes, tables, described = 0, [], b""
    for k, kind in enumerate((LITERAL, OFFSET, MATCH)):
        used = {c[0] for c in codes[k]}
        one = len(used) == 1 and rng.random() < 0.7
        # Predefined tables lack the largest offset codes.
        if not one and max(used) >= len(kind[2][1]):
            return None
        modes |= one << 6 - 2 * k
        described += bytes(used) if one else b""
        tables.append(Fse.of_one(max(used)) if one else Fse(*kind[2]))
    return out + bytes([modes]) + described + bits_of(sequence_reads(codes, tables))


def parse(data, at, size, seen, recent):
    """([(literals, offset value, match length)], literals): matches of 4 bytes or more."""
    out, literals, run, i, end = [], b"", 0, at, at + size
    while i < end:
        key = data[i:i + 4]
        before = seen.get(key)
        seen[key] = i
        if before is None or i + 4 > end:
            literals += data[i:i + 1]
            run, i = run + 1, i + 1
            continue
        length = 4
        while i + length < end and data[before + length] == data[i + length]:
            length += 1
        out.append((run, offset_value(i - before, run, recent), length))
        run, i = 0, i + length
    return out, literals


def offset_value(distance, run, recent):
    """A distance, or one of the three names of recent distances."""
    names = [*recent] if run > 0 else [recent[1], recent[2], recent[0] - 1]
    if distance not in names:
        recent[:] = [distance, *recent[:2]]
        return distance + 3
    which = names.index(distance) + (run == 0)
    if which > 0:
        recent[:] = [distance, recent[0], recent[2] if which == 1 else recent[1]]
    return which + 1 - (run == 0)


def code_of(codes, value):
    """(code, extra bits, their number)"""
    code = max(c for c, (base, _) in enumerate(codes) if base <= value)
    return code, value - codes[code][0], codes[code][1]


def sequence_reads(codes, tables):
    """(value, bits) in the order in which a decoder reads them."""
    count = len(codes[0])
    states = [[0] * count for _ in range(3)]
    for k, table in enumerate(tables):
        after = None
        for i in range(count - 1, -1, -1):
            states[k][i] = next(
                x for x, (symbol, bits, base) in enumerate(table.states) if symbol == codes[k][i][0]
                and (after is None or base <= after < base + (1 << bits)))
            after = states[k][i]
    reads = [(states[k][0], tables[k].log) for k in range(3)]
    for i in range(count):
        reads += [codes[k][i][1:] for k in (1, 2, 0)]
        if i + 1 < count:
            for k in (0, 2, 1):
                _, bits, base = tables[k].states[states[k][i]]
                reads.append((states[k][i + 1] - base, bits))
    return reads


def bits_of(reads):
    """The bytes that a decoder reads from their end."""
    text = "1" + "".join(f"{value:0{bits}b}" for value, bits in reads if bits)
    return int(text, 2).to_bytes((len(text) + 7) // 8, "little")


# ---- literals ------------------------------------------------------------------------------------

def literals_section(rng, data):
    n, kind = len(data), rng.randrange(4)
    if n > 0 and data == data[:1] * n and kind < 3:
        return small_section(1, n) + data[:1]
    if kind >= 2 and n >= 6 and len(set(data)) > 1 and max(data) < 129:
        return huffman_section(rng, data)
    return small_section(0, n) + data


def small_section(kind, n):
    if n < 32:
        return bytes([kind | n << 3])
    return (kind | (4 | n << 4 if n < 4096 else 12 | n << 4)).to_bytes(2 if n < 4096 else 3, "little")


def huffman_section(rng, data):
    """Literals by a Huffman table with its weights as they are; one stream or four."""
    weights, lengths = code_lengths(data)
    table = bytes([127 + len(weights) - 1]) + packed_weights(weights[:-1])
    codes = canonical(weights, lengths)
    encode = lambda part: bits_of([codes[b] for b in part])
    four = len(data) > 1023 or rng.random() < 0.5
    if four:
        each = (len(data) + 3) // 4
        parts = [encode(data[i * each:(i + 1) * each if i < 3 else None]) for i in range(4)]
        body = b"".join(len(p).to_bytes(2, "little") for p in parts[:3]) + b"".join(parts)
    else:
        body = encode(data)
    stored = len(table) + len(body)
    form = 0 if not four else 1 if max(len(data), stored) < 1024 else 2 if max(len(data), stored) < 16384 else 3
    width = (10, 10, 14, 18)[form]
    head = 2 | form << 2 | len(data) << 4 | stored << 4 + width
    return head.to_bytes((4 + 2 * width) // 8, "little") + table + body


def code_lengths(data):
    """(weights, lengths) of bytes 0 to the largest. All that occur have one length or one less, so that the
    code is complete."""
    used = sorted(set(data))
    width = max((len(used) - 1).bit_length(), 1)
    short = (1 << width) - len(used)            # so many have codes one bit shorter
    lengths = {b: width - (i < short) for i, b in enumerate(used)}
    most = max(lengths.values())
    return [most + 1 - lengths[b] if b in lengths else 0 for b in range(used[-1] + 1)], lengths


def packed_weights(weights):
    pairs = weights + [0] * (len(weights) % 2)
    return bytes(a << 4 | b for a, b in zip(pairs[::2], pairs[1::2]))


def canonical(weights, lengths):
    """byte -> (code, bits): by weight, then by value."""
    out, at = {}, 0
    most = max(lengths.values())
    for weight in range(1, most + 1):
        for b, w in enumerate(weights):
            if w == weight:
                bits = most + 1 - weight
                out[b] = (at >> most - bits, bits)
                at += 1 << most - bits
    return out

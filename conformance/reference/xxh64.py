# SPDX-License-Identifier: Apache-2.0
"""XXH64 with seed 0: the content checksum of zstd frames is its low half."""

from xxh3 import M, P64_1, P64_2, P64_3, P64_4, P64_5, rotl, u32, u64


def round_of(acc, lane):
    return rotl((acc + lane * P64_2) & M, 31) * P64_1 & M


def xxh64(d):
    n, at = len(d), 0
    h = P64_5
    if n >= 32:
        acc = [(P64_1 + P64_2) & M, P64_2, 0, -P64_1 & M]
        while at + 32 <= n:
            acc = [round_of(a, u64(d, at + 8 * i)) for i, a in enumerate(acc)]
            at += 32
        h = sum(rotl(a, r) for a, r in zip(acc, (1, 7, 12, 18))) & M
        for a in acc:
            h = ((h ^ round_of(0, a)) * P64_1 + P64_4) & M
    h = (h + n) & M
    while at + 8 <= n:
        h = (rotl(h ^ round_of(0, u64(d, at)), 27) * P64_1 + P64_4) & M
        at += 8
    if at + 4 <= n:
        h = (rotl(h ^ u32(d, at) * P64_1 & M, 23) * P64_2 + P64_3) & M
        at += 4
    for b in d[at:]:
        h = rotl(h ^ b * P64_5 & M, 11) * P64_1 & M
    h = (h ^ h >> 33) * P64_2 & M
    h = (h ^ h >> 29) * P64_3 & M
    return h ^ h >> 32

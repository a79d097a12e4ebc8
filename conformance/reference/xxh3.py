# SPDX-License-Identifier: Apache-2.0
"""XXH3-64 with seed 0, the checksum of the format, for inputs of any length."""

M = (1 << 64) - 1
P32_1, P32_2, P32_3 = 0x9E3779B1, 0x85EBCA77, 0xC2B2AE3D
P64_1, P64_2, P64_3 = 0x9E3779B185EBCA87, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9
P64_4, P64_5 = 0x85EBCA77C2B2AE63, 0x27D4EB2F165667C5

SECRET = bytes.fromhex(
    "b8fe6c3923a44bbe7c01812cf721ad1cded46de9839097db7240a4a4b7b3671f"
    "cb79e64eccc0e578825ad07dccff7221b8084674f743248ee03590e6813a264c"
    "3c2852bb91c300cb88d0658b1b532ea371644897a20df94e3819ef46a9deacd8"
    "a8fa763fe39c343ff9dcbbc7c70b4f1d8a51e04bcdb45931c89f7ec9d9787364"
    "eac5ac8334d3ebc3c581a0fffa1363eb170ddd51b7f0da49d316552629d4689e"
    "2b16be587d47a1fc8ff8b8d17ad031ce45cb3a8f95160428afd7fbcabb4b407e")


def u32(b, at=0):
    return int.from_bytes(b[at:at + 4], "little")


def u64(b, at=0):
    return int.from_bytes(b[at:at + 8], "little")


def rotl(x, n):
    return (x << n | x >> (64 - n)) & M


def fold(a, b):
    product = a * b
    return (product ^ product >> 64) & M


def avalanche64(h):
    h = (h ^ h >> 33) * P64_2 & M
    h = (h ^ h >> 29) * P64_3 & M
    return h ^ h >> 32


def avalanche3(h):
    h = (h ^ h >> 37) * 0x165667919E3779F9 & M
    return h ^ h >> 32


def mix16(d, at, secret):
    return fold(u64(d, at) ^ u64(SECRET, secret), u64(d, at + 8) ^ u64(SECRET, secret + 8))


def up_to_16(d):
    n = len(d)
    if n == 0:
        return avalanche64(u64(SECRET, 56) ^ u64(SECRET, 64))
    if n <= 3:
        combined = d[0] << 16 | d[n >> 1] << 24 | d[n - 1] | n << 8
        return avalanche64(combined ^ u32(SECRET) ^ u32(SECRET, 4))
    if n <= 8:
        h = (u32(d, n - 4) + (u32(d) << 32)) ^ u64(SECRET, 8) ^ u64(SECRET, 16)
        h = (h ^ rotl(h, 49) ^ rotl(h, 24)) * 0x9FB21C651E98DF25 & M
        h = (h ^ (h >> 35) + n) * 0x9FB21C651E98DF25 & M
        return h ^ h >> 28
    lo = u64(d) ^ u64(SECRET, 24) ^ u64(SECRET, 32)
    hi = u64(d, n - 8) ^ u64(SECRET, 40) ^ u64(SECRET, 48)
    swapped = int.from_bytes(lo.to_bytes(8, "little"), "big")
    return avalanche3((n + swapped + hi + fold(lo, hi)) & M)


def up_to_240(d):
    n = len(d)
    acc = n * P64_1
    if n <= 128:
        for i in range((n - 1) // 32 + 1):
            acc += mix16(d, 16 * i, 32 * i) + mix16(d, n - 16 * (i + 1), 32 * i + 16)
        return avalanche3(acc & M)
    for i in range(8):
        acc += mix16(d, 16 * i, 16 * i)
    acc = avalanche3(acc & M)
    for i in range(8, n // 16):
        acc += mix16(d, 16 * i, 16 * (i - 8) + 3)
    return avalanche3((acc + mix16(d, n - 16, 136 - 17)) & M)


def accumulate(acc, d, at, secret):
    for i in range(8):
        data = u64(d, at + 8 * i)
        key = data ^ u64(SECRET, secret + 8 * i)
        acc[i ^ 1] = (acc[i ^ 1] + data) & M
        acc[i] = (acc[i] + (key & 0xFFFFFFFF) * (key >> 32)) & M


def long_input(d):
    n = len(d)
    acc = [P32_3, P64_1, P64_2, P64_3, P64_4, P32_2, P64_5, P32_1]
    blocks = (n - 1) // 1024
    for stripe in range((n - 1) // 64):
        accumulate(acc, d, 64 * stripe, 8 * (stripe % 16))
        if stripe % 16 == 15 and stripe // 16 < blocks:
            for i in range(8):
                acc[i] = (acc[i] ^ acc[i] >> 47 ^ u64(SECRET, 128 + 8 * i)) * P32_1 & M
    accumulate(acc, d, n - 64, 192 - 64 - 7)
    h = n * P64_1
    for i in range(4):
        h += fold(acc[2 * i] ^ u64(SECRET, 11 + 16 * i), acc[2 * i + 1] ^ u64(SECRET, 19 + 16 * i))
    return avalanche3(h & M)


def xxh3_64(data):
    data = bytes(data)
    if len(data) <= 16:
        return up_to_16(data)
    return up_to_240(data) if len(data) <= 240 else long_input(data)

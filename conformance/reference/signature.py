#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Signatures of files, section 22.1 of spec/l4d.md: Ed25519ph of RFC 8032, by its formulas.

  signature.py FILE   prints the public key and 'right' or 'wrong', or 'not signed'
"""

import hashlib
import sys

P = 2 ** 255 - 19
Q = 2 ** 252 + 27742317777372353535851937790883648493
D = -121665 * pow(121666, P - 2, P) % P
PREFIX = b"SigEd25519 no Ed25519 collisions" + b"\x01\x00"   # prehashed, no context
TRAILER = 100


def recover_x(y, sign):
    if y >= P:
        return None
    x2 = (y * y - 1) * pow(D * y * y + 1, P - 2, P) % P
    x = pow(x2, (P + 3) // 8, P)
    if (x * x - x2) % P:
        x = x * pow(2, (P - 1) // 4, P) % P
    if (x * x - x2) % P or (x == 0 and sign):
        return None
    return P - x if x & 1 != sign else x


def add(a, b):
    """Points as (x, y)."""
    (x1, y1), (x2, y2) = a, b
    product = D * x1 * x2 * y1 * y2
    return ((x1 * y2 + x2 * y1) * pow(1 + product, P - 2, P) % P,
            (y1 * y2 + x1 * x2) * pow(1 - product, P - 2, P) % P)


def times(n, point):
    sum_ = (0, 1)
    while n:
        if n & 1:
            sum_ = add(sum_, point)
        point = add(point, point)
        n >>= 1
    return sum_


BASE_Y = 4 * pow(5, P - 2, P) % P
BASE = (recover_x(BASE_Y, 0), BASE_Y)


def encode(point):
    x, y = point
    return (y | (x & 1) << 255).to_bytes(32, "little")


def decode(data):
    y = int.from_bytes(data, "little")
    x = recover_x(y & (1 << 255) - 1, y >> 255)
    return None if x is None else (x, y & (1 << 255) - 1)


def public_key(seed):
    h = int.from_bytes(hashlib.sha512(seed).digest()[:32], "little")
    return encode(times((h & (1 << 254) - 8) | 1 << 254, BASE))


def is_right(key, signature, message_hash):
    """message_hash: SHA-512 of the message."""
    point, r = decode(key), decode(signature[:32])
    s = int.from_bytes(signature[32:], "little")
    if point is None or r is None or s >= Q:
        return False
    k = hashlib.sha512(PREFIX + signature[:32] + key + message_hash).digest()
    return times(s, BASE) == add(r, times(int.from_bytes(k, "little") % Q, point))


def check_file(path):
    """(key, whether the signature is right), or None where a file ends without one."""
    with open(path, "rb") as file:
        data = file.read()
    if len(data) < TRAILER or data[-TRAILER:-96] != b"L4DS":
        return None
    key, signature = data[-96:-64], data[-64:]
    return key, is_right(key, signature, hashlib.sha512(data[:-64]).digest())


def main():
    found = check_file(sys.argv[1])
    print("not signed" if found is None else
          f"{found[0].hex()} {'right' if found[1] else 'wrong'}")


if __name__ == "__main__":
    main()

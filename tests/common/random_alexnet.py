#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes random weights for LPIPS with AlexNet: random_alexnet.py FILE.safetensors"""

import array
import json
import random
import struct
import sys

LAYERS = {0: (3, 64, 11), 3: (64, 192, 5), 6: (192, 384, 3), 8: (384, 256, 3), 10: (256, 256, 3)}


def main():
    random.seed(3)
    header, values = {}, array.array("f")

    def add(name, shape, low, high):
        begin, count = 4 * len(values), 1
        for length in shape:
            count *= length
        values.extend(random.uniform(low, high) for _ in range(count))
        header[name] = {"dtype": "F32", "shape": shape, "data_offsets": [begin, 4 * len(values)]}

    for k, (index, (ins, outs, side)) in enumerate(LAYERS.items()):
        bound = (6 / (ins * side * side)) ** 0.5
        add(f"features.{index}.weight", [outs, ins, side, side], -bound, bound)
        add(f"features.{index}.bias", [outs], -0.1, 0.1)
        add(f"lin{k}.model.1.weight", [1, outs, 1, 1], 0, 0.1)
    if sys.byteorder == "big":
        values.byteswap()
    text = json.dumps(header).encode()
    with open(sys.argv[1], "wb") as file:
        file.write(struct.pack("<Q", len(text)) + text + values.tobytes())


main()

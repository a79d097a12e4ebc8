#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Reads an .l4d file as spec/l4d.md says and explains every byte of it.

The reading is that of conformance/reference, the decoder that is written from the specification
alone; what stands here shows what it read. Bytes of zstd frames are not explained.

  decode_tiny.py [FILE]            the bytes, annotated, then the decoded Gaussians
  decode_tiny.py --values [FILE]   every decoded value as the bits of its binary32
  decode_tiny.py --base ..         without SH chunks of pages: SH is what the base holds
"""

import struct
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1] / "conformance" / "reference"))

from arithmetic import Invalid, bits_of_f32, require    # noqa: E402
from decoder import Decoder, Query                      # noqa: E402
from file import File                                   # noqa: E402

EXACT = "mean_t_double"     # the one attribute that is binary64
WINDOW = "window"           # and the one of integers


def dump(file):
    """Lines that show every byte once, with what it means."""
    lines, at = [], 0

    def show(begin, end, text):
        for i in range(begin, end, 8):
            row = file.data[i:min(i + 8, end)].hex(" ")
            lines.append(f"{i:04x}  {row:<23}  {text if i == begin else ''}".rstrip())

    for begin, end, text in sorted(set(file.claims)):
        if begin > at:
            show(at, begin, "padding")
        require(begin >= at, "CHNK-4", f"byte {begin} read twice: {text}")
        show(begin, end, text)
        at = end
    if at < len(file.data):
        show(at, len(file.data), "not referred to")
    return lines


def values(gaussians):
    return [f"{name} {i} {k} {bits_of(name, v)}"
            for i, g in enumerate(gaussians) for name, row in g.items() for k, v in enumerate(row)]


def bits_of(name, v):
    if name == EXACT:
        return struct.pack(">d", v).hex()
    if name == WINDOW:
        return f"{v:08x}"
    return f"{bits_of_f32(v):08x}"


def decimals(gaussians):
    lines = []
    for i, g in enumerate(gaussians):
        for name, row in g.items():
            if name == EXACT:
                continue
            lines.append(f"Gaussian {i}  {name:<12}  " + "  ".join(f"{v:.9g}" for v in row))
    return lines


def decode(data, base=False):
    """The File, with what its bytes mean, and the Gaussians, each a dictionary of rows."""
    file = File(data, explain=True)
    return file, list(Decoder(file).gaussians(Query(base_only=base)))


def main(arguments):
    only_values = "--values" in arguments
    paths = [a for a in arguments if not a.startswith("-")]
    try:
        file, gaussians = decode(Path(paths[0] if paths else HERE / "tiny.l4d").read_bytes(),
                                 "--base" in arguments)
    except Invalid as error:
        print(f"decode_tiny.py: {error}", file=sys.stderr)
        return 1
    print("\n".join(values(gaussians) if only_values else dump(file) + [""] + decimals(gaussians)))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

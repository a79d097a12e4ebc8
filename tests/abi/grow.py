#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes the public headers as a later version could have them.

Each versioned struct gets new fields at its end, and each list of names that ends in a count gets a
new name. A library built from these headers must still serve programs that were compiled against
the headers of today.

usage: grow.py HEADERS OUT
"""
import pathlib
import re
import sys

# Counts that the bitstream fixes for ever, and those that only bound an id: no array follows them.
FIXED_COUNTS = {"L4D_COMPONENT_COUNT", "L4D_WEIGHT_COUNT"}


def grow_structs(text):
    """A struct that begins with struct_size gets 24 bytes more; returns the text and how many grew."""
    pattern = re.compile(r"(typedef struct (\w+) \{\n  size_t struct_size;.*?)(\n\} \2;)", re.S)
    return pattern.subn(r"\1\n  uint64_t grown_[3];\3", text)


def grow_enums(text):
    """An enumeration that ends in X_COUNT gets one name more before that; returns how many did."""
    added = []

    def add(match):
        count = match.group(2)
        if count in FIXED_COUNTS:
            return match.group(0)
        value = match.group(3) or ""
        if value:
            value = f" = {int(value.strip(' =')) + 1}"
        added.append(count)
        grown = count.replace("_COUNT", "_GROWN_")
        return f"{match.group(1)}{grown},\n  {count}{value}\n}};"
    return re.sub(r"(\n  )(L4D_\w+_COUNT)( = \d+)?\n\};", add, text), len(added)


def main():
    source, out = map(pathlib.Path, sys.argv[1:3])
    structs = enums = 0
    for header in sorted(source.glob("l4d/**/*.h*")):
        text = header.read_text()
        text, more = grow_structs(text)
        structs += more
        text, more = grow_enums(text)
        enums += more
        target = out / header.relative_to(source)
        target.parent.mkdir(parents=True, exist_ok=True)
        if not target.exists() or target.read_text() != text:
            target.write_text(text)
    print(f"{structs} structs and {enums} lists have grown")
    # All versioned structs but those that only the library makes.
    versioned = sum(len(re.findall(r"\{\n  size_t struct_size;", h.read_text()))
                    for h in source.glob("l4d/**/*.h"))
    if structs != versioned or structs == 0 or enums == 0:
        sys.exit(f"{versioned} structs have a struct_size: grow.py does not find all of them")


if __name__ == "__main__":
    main()

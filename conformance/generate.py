#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Makes the conformance vectors and suite.json: equal files on every machine.

  generate.py --write [--tool L4DCODEC]   writes vectors/ and suite.json; the tool encodes those of group
                                          core/encoder-*, which otherwise stay as they are
  generate.py --check [--tool L4DCODEC]   exit status 1 and a line for each file that would not come out again
  generate.py --count N [--first SEED] FOLDER
                                          writes N more random legal streams and a suite.json of them
  generate.py --limits LEVEL[,LEVEL..] FOLDER
                                          writes streams at each limit of conformance levels and just beyond it,
                                          which have up to 33 MiB at level 1 and 512 MiB at level 6, and suite.json

Needs the folders spec and conformance/reference beside it.
"""

import argparse
import multiprocessing
import sys
from pathlib import Path

sys.dont_write_bytecode = True
HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE / "generate"), str(HERE / "reference"), str(HERE.parent / "spec" / "examples")]

import catalogue            # noqa: E402
import encoded              # noqa: E402
import faults               # noqa: E402
import limits               # noqa: E402
import suite                # noqa: E402
from catalogue import Vector    # noqa: E402
from random_stream import RandomScene   # noqa: E402


def vectors(folder, tool):
    """All vectors; those of the encoder are read from the folder where there is no tool."""
    yield from catalogue.core()
    yield from encoded.vectors(folder, tool)
    yield from catalogue.uncommon()
    yield from limits.small()
    for title, data in faults.faults():
        yield Vector("faulty", faults.slug(title), f"breaks {title}", data, [title.split()[0]],
                     "one edit of a legal stream", title=title)


def files(folder, tool):
    """path -> bytes of everything that is committed"""
    made = list(vectors(folder, tool))
    names = [v.path() for v in made]
    twice = {name for name in names if names.count(name) > 1}
    if twice:
        raise ValueError(f"two vectors have the name {sorted(twice)}")
    document = suite.document(made, entries_of(made))
    return {**{f"vectors/{v.path()}": v.data for v in made},
            "suite.json": suite.text(document).encode("utf-8")}


def entries_of(made):
    with multiprocessing.Pool() as pool:
        return pool.map(suite.entry, made, chunksize=4)


def write(folder, made):
    for name, data in made.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.exists() or path.read_bytes() != data:
            path.write_bytes(data)
    for path in (folder / "vectors").rglob("*.l4d"):
        if path.relative_to(folder).as_posix() not in made:
            path.unlink()


def differences(folder, made):
    there = {p.relative_to(folder).as_posix() for p in (folder / "vectors").rglob("*") if p.is_file()}
    out = [f"{name} is no vector" for name in sorted(there - set(made))]
    for name, data in made.items():
        path = folder / name
        if not path.exists():
            out.append(f"{name} is missing")
        elif path.read_bytes() != data:
            out.append(f"{name} comes out differently")
    return out


def more(count, first):
    return [Vector("random", f"random-{seed}", "all codings in one random scene", RandomScene(seed).build(),
                   made_by=f"random scene, seed {seed}") for seed in range(first, first + count)]


def write_suite(folder, made, entries):
    write(folder, {**{f"vectors/{v.path()}": v.data for v in made},
                   "suite.json": suite.text(suite.document(made, entries)).encode("utf-8")})


def main(arguments):
    parser = argparse.ArgumentParser(usage=__doc__)
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--count", type=int)
    parser.add_argument("--first", type=int, default=100000)
    parser.add_argument("--limits", type=lambda text: [int(word) for word in text.split(",")])
    parser.add_argument("--tool")
    parser.add_argument("folder", nargs="?", type=Path)
    args = parser.parse_args(arguments)
    if args.count is not None:
        if args.folder is None:
            parser.error("--count needs a folder")
        made = more(args.count, args.first)
        write_suite(args.folder, made, entries_of(made))
        print(f"{args.count} vectors in {args.folder}")
        return 0
    if args.limits is not None:
        if args.folder is None:
            parser.error("--limits needs a folder")
        made = list(limits.vectors(args.limits, args.limits))
        write_suite(args.folder, made, [suite.entry(vector) for vector in made])
        print(f"{len(made)} vectors in {args.folder}")
        return 0
    if args.write == args.check:
        parser.error("one of --write, --check, --count and --limits")
    made = files(HERE, args.tool)
    if args.write:
        write(HERE, made)
    found = differences(HERE, made)
    size = sum(map(len, made.values()))
    print("\n".join(found) if found else f"{len(made) - 1} vectors and suite.json, {size} bytes, come out again")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Decodes an .l4d file and prints digests (appendix F) of what it holds, or which rule it breaks.

  l4d.py [OPTIONS] FILE

  --query all                everything (the default)
  --query time:T             what may be visible at T, in seconds
  --query range:A:B          what may be visible from A to B
  --query buckets:L/K,..     buckets K of layers L, in ascending order
  --query header             the header, decoded
  --query validate           every rule of the format, also those that only validators check
  --query demand             what playing it asks for (section 18.2), and the profile it keeps to
  --level N                  only layers of level N or less
  --tier N                   only layers of tier N or less
  --detail base|full         base: SH chunks of pages stay unread
  --packed                   the integers of pages instead of attributes; streams of profile 1 only
  --whole-buckets            all pages of a bucket of which one may be visible

Prints one line of JSON:
  {"num_gaussians": N, "digests": {NAME: XXH3-64, .., "all": ..}}
  {"refused": CLAUSE, "offset": BYTE, "message": ..}
  {"valid": true}, {"demand": {..}}, {"header": {..}} for these queries
Exit status: 0 an answer, 1 refused, 2 usage.
"""

import argparse
import json
import sys
from pathlib import Path

sys.dont_write_bytecode = True

import digests
import levels
import validate
from arithmetic import Invalid
from decoder import Decoder, Query


def parse_query(text, args):
    """The Query of the command line, or None where it is no query of Gaussians."""
    kind, _, rest = text.partition(":")
    options = {"most_level": args.level, "most_tier": args.tier, "base_only": args.detail == "base",
               "whole_buckets": args.whole_buckets}
    if kind == "all":
        return Query(**options)
    if kind == "time":
        return Query(float(rest), float(rest), **options)
    if kind == "range":
        begin, end = map(float, rest.split(":"))
        if not begin <= end:
            raise ValueError("a range ends before it begins")
        return Query(begin, end, **options)
    if kind == "buckets":
        listed = [tuple(map(int, item.split("/"))) for item in rest.split(",") if item]
        if any(len(b) != 2 for b in listed) or listed != sorted(set(listed)):
            raise ValueError("buckets are LAYER/BUCKET, in ascending order")
        return Query(buckets=listed, **options)
    if text in ("header", "validate", "demand"):
        return None
    raise ValueError(f"unknown query {text}")


def answer(data, args, query):
    if args.query == "validate":
        validate.validate_file(data)
        return {"valid": True}
    decoder = Decoder(data)
    if args.query == "header":
        return {"header": decoder.header}
    if args.query == "demand":
        return {"demand": demand(decoder)}
    if args.packed and not levels.keeps_profile(decoder.header, levels.INDEXED):
        return {"unavailable": "packed"}
    of = digests.of_packed_form if args.packed else digests.of_attributes
    found = of(decoder, query)
    count = sum(selected.record["num_gaussians"] for selected in decoder.select(query))
    return {"num_gaussians": count, "digests": found}


def demand(decoder):
    d = levels.demand(decoder)
    keeps = [p for p in (1, 2, 3) if levels.keeps_profile(decoder.header, p)]
    return {"profile": min(keeps, default=0), "level": d.level(), "gaussians": d.gaussians,
            "table_bytes": d.table_bytes, "instant_bytes": d.instant_bytes,
            "start_bytes": d.start_bytes, "memory_bytes": d.memory_bytes,
            "symbols": d.symbols}


def main(arguments):
    parser = argparse.ArgumentParser(usage=__doc__, add_help=False)
    parser.add_argument("--query", default="all")
    parser.add_argument("--level", type=int, default=255)
    parser.add_argument("--tier", type=int, default=255)
    parser.add_argument("--detail", choices=("full", "base"), default="full")
    for flag in ("--packed", "--whole-buckets"):
        parser.add_argument(flag, action="store_true")
    parser.add_argument("file")
    args = parser.parse_args(arguments)
    try:
        query = parse_query(args.query, args)
        data = Path(args.file).read_bytes()
    except (ValueError, OSError) as error:
        print(f"l4d.py: {error}", file=sys.stderr)
        return 2
    try:
        print(json.dumps(answer(data, args, query)))
    except Invalid as broken:
        print(json.dumps({"refused": broken.clause, "offset": broken.offset,
                          "message": str(broken)}))
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

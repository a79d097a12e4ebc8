#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Runs the suite against the decoders of this repository: report.py L4DCODEC [--write FILE] [-j N]

The library with both backends and on other architectures where it was built for them, the reference decoder, and the wrong decoders, each with the vector that is meant to
catch it. --write: a page with what came out. The last line is N passed, N failed: of queries, and of mistakes that
were caught. Exit status: 0 where nothing failed.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
PYTHON = [sys.executable, "-B"]


def decoders(tool):
    """(name, arguments of run.py)"""
    adapter = ["--adapter", str(HERE / "adapters" / "l4dcodec.py"), "--", tool]
    yield "library, backend cpu", [*adapter, "--backend", "cpu"]
    yield "library, backend reference", [*adapter, "--backend", "reference"]
    batch = ["--adapter", str(HERE / "adapters" / "batch.py"), "--"]
    cross, web = Path(tool).resolve().parents[1] / "cross", HERE.parent / "build" / "wasm"
    for name, command, program in (
            ("library on aarch64, emulated", ["qemu-aarch64", "-L", "/usr/aarch64-linux-gnu"], cross / "aarch64/build/bin/l4d_answer"),
            ("library as WebAssembly, in Node", ["node", "--no-experimental-fetch"], web / "bin/l4d_answer.js")):
        if program.exists() and shutil.which(command[0]):
            yield name, [*batch, *command, str(program)]
        else:
            print(f"{name:<28} not run: {program} is made by the tests cross/*")
    yield "reference decoder", ["--adapter", str(HERE / "adapters" / "reference.py"), "--", "reference"]


def run_suite(arguments, jobs):
    """What run.py writes of all queries."""
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run([*PYTHON, str(HERE / "run.py"), "--quiet", "-j", str(jobs), "--json", f"{folder}/json",
                               *arguments], capture_output=True, text=True, check=False)
        for line in done.stdout.splitlines()[:20]:
            if line.startswith("FAIL"):
                print(line)
        return json.loads(Path(f"{folder}/json").read_text(encoding="utf-8"))


def mistakes():
    """(name, vector, about)"""
    listed = subprocess.run([*PYTHON, str(HERE / "wrong" / "decoder.py"), "--list"], capture_output=True, text=True,
                            check=True).stdout
    return [line.split(maxsplit=2) for line in listed.splitlines()]


def is_caught(name, vector):
    done = subprocess.run([*PYTHON, str(HERE / "run.py"), "--quiet", "--only", vector, "--",
                           *PYTHON, str(HERE / "wrong" / "decoder.py"), name], capture_output=True, text=True,
                          check=False)
    return done.returncode == 1 and f"FAIL {vector} " in done.stdout


def last_line(*command):
    return subprocess.run([*PYTHON, *map(str, command)], capture_output=True, text=True,
                          check=False).stdout.splitlines()[-1]


def groups(suite):
    for name in dict.fromkeys(v["group"] for v in suite["vectors"]):
        of = [v for v in suite["vectors"] if v["group"] == name]
        yield name, len(of), sum(len(v["queries"]) for v in of), sum(v["bytes"] for v in of)


def page(found, caught, jobs):
    suite = json.loads((HERE / "suite.json").read_text(encoding="utf-8"))
    rows = list(groups(suite))
    total = ["all", *(sum(row[k] for row in rows) for k in (1, 2, 3))]
    lines = ["# Conformance", "",
             "`./dev conformance --report` makes this page. [The suite](../conformance/README.md) is for decoders of",
             "others; here it runs against those of this repository.", "",
             "| group | vectors | queries | bytes |", "|---|---:|---:|---:|"]
    lines += [f"| {name} | {vectors:,} | {queries:,} | {size:,} |" for name, vectors, queries, size in [*rows, total]]
    lines += ["", f"Clauses: {last_line(HERE / 'clauses.py', '--check')}, each with a faulty vector or the reason why",
              "there is none ([list](../conformance/clauses.md)).", "",
              f"Reference decoder: {last_line(HERE / 'coverage.py', '-j', jobs)}",
              "([list](../conformance/unreached.json)).", "", "## Decoders", "",
              f"Seconds are those of {jobs} processes at once.", "",
              "| decoder | passed | failed | skipped | rules named | seconds |", "|---|---:|---:|---:|---:|---:|"]
    for name, result in found:
        negative = [r for r in result["results"] if "refused" in (r["answer"] or {})]
        named = sum("-" in r["answer"]["refused"] and r["answer"]["refused"].isupper() for r in negative)
        lines.append(f"| {name} | {result['passed']:,} | {result['failed']} | {result['skipped']} | "
                     f"{named} of {len(negative)} | {result['seconds']:.0f} |")
    lines += ["", "## Wrong decoders", "",
              "Each is the reference decoder with one mistake. The vector is the one that is meant to catch it.", "",
              "| mistake | vector | caught |", "|---|---|---|"]
    lines += [f"| {about} | {vector} | {'yes' if yes else 'NO'} |" for _, vector, about, yes in caught]
    return "\n".join(lines) + "\n"


def main(arguments):
    parser = argparse.ArgumentParser(usage=__doc__)
    parser.add_argument("tool")
    parser.add_argument("--write", type=Path)
    parser.add_argument("-j", type=int, default=os.cpu_count() or 1)
    args = parser.parse_args(arguments)
    found = []
    for name, options in decoders(args.tool):
        found.append((name, run_suite(options, args.j)))
        result = found[-1][1]
        print(f"{name:<28} {result['passed']} passed, {result['failed']} failed, {result['skipped']} skipped, "
              f"{result['seconds']:.1f} s", flush=True)
    caught = []
    for name, vector, about in mistakes():
        caught.append((name, vector, about, is_caught(name, vector)))
        print(f"{name:<28} {'caught by' if caught[-1][3] else 'NOT CAUGHT by'} {vector}", flush=True)
    if args.write:
        args.write.write_text(page(found, caught, args.j), encoding="utf-8")
    passed = sum(result["passed"] for _, result in found) + sum(yes for *_, yes in caught)
    failed = sum(result["failed"] for _, result in found) + sum(not yes for *_, yes in caught)
    print(f"{passed} passed, {failed} failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

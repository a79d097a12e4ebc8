#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The compiler of a build compiles the sources of targets that are not built: its errors and warnings. The code is
neither sanitized nor optimised nor linked; a compiler cache has it the next time.

    compiles.py [-j N] BUILD_DIR TARGET..."""
import argparse
import concurrent.futures
import json
import os
import pathlib
import shlex
import subprocess
import sys
import tempfile

WITH_VALUE, WITHOUT = {"-o", "-MT", "-MF"}, ("-MD", "-O", "-g", "-fsanitize", "-fno-sanitize", "-fno-omit-frame-pointer")


def command_of(entry, out):
    """The command of compile_commands.json, for another object."""
    words, kept = iter(shlex.split(entry["command"])), []
    for word in words:
        if word in WITH_VALUE:
            next(words)
        elif not word.startswith(WITHOUT):
            kept.append(word)
    return [*kept, "-O0", "-o", str(out)]


def main():
    parser = argparse.ArgumentParser(usage=__doc__)
    parser.add_argument("-j", type=int, default=os.cpu_count())
    parser.add_argument("build", type=pathlib.Path)
    parser.add_argument("targets", nargs="+")
    args = parser.parse_args()
    everything = json.loads((args.build / "compile_commands.json").read_text(encoding="utf-8"))
    entries = []
    for target in args.targets:
        found = [e for e in everything if f"/{target}.dir/" in e["command"]]
        if not found:
            sys.exit(f"{target} has no sources")
        # A source that the target's build makes may not be there.
        entries += [e for e in found if pathlib.Path(e["file"]).exists()]

    def compile_one(number):
        entry = entries[number]
        command = command_of(entry, pathlib.Path(folder) / f"{number}.o")
        return subprocess.run(command, cwd=entry["directory"], capture_output=True, text=True, check=False)

    with tempfile.TemporaryDirectory() as folder, concurrent.futures.ThreadPoolExecutor(args.j) as pool:
        done = list(pool.map(compile_one, range(len(entries))))
    failed = [d for d in done if d.returncode != 0]
    for d in failed:
        sys.stderr.write(d.stderr)
    print(f"{len(done) - len(failed)} of {len(done)} files compile")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())

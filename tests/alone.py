#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Does each case of the GoogleTest suites pass by itself, and in any order?

    alone.py [-j N] BUILD_DIR   runs each case of BUILD_DIR/suites (suites.py) in a process of its own; then each
                                program once, all its cases in a random order

ctest runs the cases of a suite in one process, in the order of the source: what a case leaves behind for the
next is not seen there. Exit status 1 where a case or a program failed."""
import argparse
import concurrent.futures
import json
import os
import pathlib
import random
import re
import subprocess
import sys
import tempfile

TIMEOUT = 1800  # seconds, of a case; a program has that for each of its suites


def run(what, command, seconds):
    """(what, outcome, output)"""
    with tempfile.TemporaryDirectory() as folder:
        try:
            done = subprocess.run(command, capture_output=True, text=True, errors="replace", check=False, cwd=folder,
                                  timeout=seconds, stdin=subprocess.DEVNULL)
        except subprocess.TimeoutExpired:
            return what, "failed", f"no end after {seconds} s"
    output = done.stdout + done.stderr
    if done.returncode != 0 or not re.search(r"^\[==========\] [1-9]\d* tests? from .* ran\.", output, re.M):
        return what, "failed", output
    return what, "passed" if re.search(r"^\[  PASSED  \] [1-9]", output, re.M) else "skipped", output


def jobs_of(build, seed):
    """(what, command, seconds) of each case, then of each program"""
    programs = {}
    for path in sorted((build / "suites").rglob("*.json")):
        known = json.loads(path.read_text(encoding="utf-8"))
        programs.setdefault(known["program"], []).append(known)
    for program, suites in programs.items():
        for suite in suites:
            for case in suite["cases"]:
                if "DISABLED_" not in suite["suite"] + case:
                    name = f"{suite['suite']}.{case}"
                    yield f"{pathlib.Path(program).name} {name}", [program, f"--gtest_filter={name}"], TIMEOUT
    for program, suites in programs.items():
        order = ["--gtest_shuffle", f"--gtest_random_seed={seed}"]
        yield " ".join([pathlib.Path(program).name, *order]), [program, *order], TIMEOUT * len(suites)


def main():
    parser = argparse.ArgumentParser(usage=__doc__)
    parser.add_argument("-j", type=int, default=os.cpu_count())
    parser.add_argument("build", type=pathlib.Path)
    args = parser.parse_args()
    seed, count = random.randrange(1, 100000), {"passed": 0, "failed": 0, "skipped": 0}
    with concurrent.futures.ThreadPoolExecutor(args.j) as pool:
        for what, outcome, output in pool.map(lambda job: run(*job), jobs_of(args.build.resolve(), seed)):
            count[outcome] += 1
            if outcome == "failed":
                print(f"{output}\nFAILED: {what}", flush=True)
    print("alone and shuffled: " + ", ".join(f"{n} {outcome}" for outcome, n in count.items()))
    return 0 if count["passed"] and not count["failed"] else 1


if __name__ == "__main__":
    sys.exit(main())

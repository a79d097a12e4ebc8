#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What ctest knows of a GoogleTest program: one test for each suite.

    suites.py PROGRAM PREFIX BUILD_DIR OUT [PROPERTY VALUE]...

Writes OUT, which ctest includes: for each suite of PROGRAM the test PREFIX+SUITE, which runs its cases in
one process, in the folder of OUT, and leaves their results in BUILD_DIR/results/suites. Of each suite the names of its cases go to
BUILD_DIR/suites, so that tests/summary.py knows which did not run. Suites whose names end in Nightly have the label
nightly too: they are measurements that take long. Those of slow.txt begin first: without a COST, a new machine
begins them in the order of these files, and ends with one long test and an idle processor."""
import json
import pathlib
import shutil
import subprocess
import sys

SLOW = pathlib.Path(__file__).with_name("slow.txt")
COST = 50  # of suites that it lists: they begin first


def suites_of(listing):
    """Suite -> cases, of what --gtest_list_tests prints."""
    suites, cases = {}, None
    for line in listing.splitlines():
        name = line.split("  #")[0].rstrip()  # a comment says what a parameter is
        if name.startswith("  ") and cases is not None:
            cases.append(name.strip())
        elif name.endswith(".") and " " not in name:
            cases = suites.setdefault(name[:-1], [])
    return {suite: cases for suite, cases in suites.items() if cases}


def quoted(text):
    return f"[==[{text}]==]"


def main(program, prefix, build, out, *properties):
    build, out = pathlib.Path(build), pathlib.Path(out)
    properties = ["WORKING_DIRECTORY", quoted(out.parent), *properties]
    slow = {line.split(":")[0] for line in SLOW.read_text(encoding="utf-8").splitlines()}
    listing = subprocess.run([program, "--gtest_list_tests"], capture_output=True, text=True, check=False)
    suites = suites_of(listing.stdout)
    if listing.returncode != 0 or not suites:
        sys.exit(f"{program} --gtest_list_tests: {listing.stderr or 'it lists no test'}")
    lines = []
    shutil.rmtree(build / "suites" / prefix, ignore_errors=True)  # suites that are no more
    for suite, cases in suites.items():
        known = build / "suites" / f"{prefix}{suite}.json"
        known.parent.mkdir(parents=True, exist_ok=True)
        known.write_text(json.dumps({"program": program, "suite": suite, "cases": cases}), encoding="utf-8")
        command = [program, f"--gtest_filter={suite}.*",
                   f"--gtest_output=xml:{build}/results/suites/{prefix}{suite}.xml"]
        labels = ["LABELS", quoted("unit;nightly")] if suite.endswith("Nightly") else []
        cost = ["COST", str(COST)] if prefix + suite in slow else []
        lines += [f"add_test({quoted(prefix + suite)} {' '.join(map(quoted, command))})",
                  f"set_tests_properties({quoted(prefix + suite)} PROPERTIES {' '.join([*properties, *labels, *cost])})"]
    out.write_text("\n".join([*lines, ""]), encoding="utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:])

#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The last line of a test run: adds up what ctest wrote with --output-junit.

    summary.py FILE...      prints "1240 passed, 0 failed, 12 skipped", above it what failed, and above
                            that the tests that took longest
    summary.py --self-test

Exit status 1 where a test failed or could not be run, or where a file says nothing."""
import pathlib
import sys
import tempfile
import xml.etree.ElementTree as ElementTree


def outcome(case):
    """ "passed", "failed" or "skipped"; a test whose program is missing has failed."""
    status = case.get("status")
    if status == "run":
        return "passed"
    if status == "disabled":
        return "skipped"
    skipped = case.find("skipped")
    by_its_own_word = skipped is not None and skipped.get("message", "").startswith("SKIP_")
    return "skipped" if status == "notrun" and by_its_own_word else "failed"


MOST_SLOW = 20


def print_slowest(cases, out):
    """The tests that took longest: (name, seconds)."""
    slow = sorted(cases, key=lambda case: -case[1])[:MOST_SLOW]
    print(f"the {len(slow)} slowest tests, in seconds:", file=out)
    for name, seconds in slow:
        print(f"  {seconds:7.1f}  {name}", file=out)


def summarise(paths, out):
    """Prints to `out`; whether nothing failed."""
    count = {"passed": 0, "failed": 0, "skipped": 0}
    failures = []
    times = []
    for path in paths:
        try:
            cases = list(ElementTree.parse(path).getroot().iter("testcase"))
        except (OSError, ElementTree.ParseError):
            cases = []
        if not cases:
            failures.append(f"{path}: no result of any test")
        for case in cases:
            result = outcome(case)
            count[result] += 1
            times.append((f"{pathlib.Path(path).name}: {case.get('name')}", float(case.get("time", 0))))
            if result == "failed":
                failures.append(f"{pathlib.Path(path).name}: {case.get('name')}")
    print_slowest(times, out)
    for failure in failures:
        print("failed: " + failure, file=out)
    print(", ".join(f"{n} {what}" for what, n in count.items()), file=out)
    return not failures


SAMPLE = """<?xml version="1.0" encoding="UTF-8"?>
<testsuite name="Linux-c++" tests="5" failures="1" disabled="0" skipped="1">
<testcase name="a" classname="a" time="0.1" status="run"/>
<testcase name="b" classname="b" time="0.1" status="notrun">
<skipped message="SKIP_RETURN_CODE=77"/></testcase>
<testcase name="c" classname="c" time="0.1" status="notrun">
<skipped message="SKIP_REGULAR_EXPRESSION_MATCHED"/></testcase>
{more}</testsuite>
"""


def self_test():
    import io
    cases = [("", True, "1 passed, 0 failed, 2 skipped"),
             ('<testcase name="d" status="disabled"><skipped message="Disabled"/></testcase>', True,
              "1 passed, 0 failed, 3 skipped"),
             ('<testcase name="d" status="fail"><failure message=""/></testcase>', False,
              "1 passed, 1 failed, 2 skipped"),
             ('<testcase name="d" status="notrun"><skipped message="Unable to find executable"/>'
              "</testcase>", False, "1 passed, 1 failed, 2 skipped")]
    with tempfile.TemporaryDirectory() as folder:
        files = []
        for number, (more, good, line) in enumerate(cases):
            path = pathlib.Path(folder) / f"{number}.xml"
            path.write_text(SAMPLE.format(more=more), encoding="utf-8")
            files.append(path)
            out = io.StringIO()
            assert summarise([path], out) == good, more
            assert out.getvalue().split("\n")[-2] == line, out.getvalue()
        out = io.StringIO()
        assert not summarise(files, out)
        assert out.getvalue().endswith("failed: 2.xml: d\nfailed: 3.xml: d\n"
                                       "4 passed, 2 failed, 9 skipped\n"), out.getvalue()
        out = io.StringIO()
        assert not summarise([pathlib.Path(folder) / "none.xml"], out), "no file is no success"
        assert out.getvalue().endswith("0 passed, 0 failed, 0 skipped\n")
    print("summary: self-test passed")


if __name__ == "__main__":
    if sys.argv[1:] == ["--self-test"]:
        self_test()
    else:
        sys.exit(0 if summarise(sys.argv[1:], sys.stdout) else 1)

#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The end of a test run: adds up what the tests of build folders have left there.

    summary.py [--seconds FILE] BUILD_DIR...
                            prints what took longest, what was skipped and why, what failed, and as the last
                            line "1240 passed, 0 failed, 12 skipped". FILE: lines "SECONDS BUDGET WHAT" of builds
                            and runs
    summary.py --self-test

BUILD_DIR/results/ctest.xml is what ctest wrote with --output-junit. A test that is a suite of GoogleTest
(suites.py) counts by its cases: BUILD_DIR/suites/NAME.json names them, and the program wrote their results to
BUILD_DIR/results/suites/NAME.xml. If it ended before that, its output says how far it came; the cases that
did not run have failed.

A test of more than 20 s has a line in slow.txt, "NAME: why it takes that long"; this program names those that have
none, and fails for none: a busy machine makes any test long.

Exit status 1 where a test failed or could not be run, or where a folder has no results."""
import collections
import json
import pathlib
import re
import sys
import tempfile
import xml.etree.ElementTree as ElementTree

LONG = 20  # seconds
Result = collections.namedtuple("Result", "name outcome why")


def ctest_outcome(test):
    """ "passed", "failed" or "skipped"; a test whose program is missing has failed."""
    status = test.get("status")
    if status == "run":
        return "passed"
    if status == "disabled":
        return "skipped"
    skipped = test.find("skipped")
    by_its_own_word = skipped is not None and skipped.get("message", "").startswith("SKIP_")
    return "skipped" if status == "notrun" and by_its_own_word else "failed"


def output_of(test):
    return test.findtext("system-out") or ""


def skip_reason(output):
    found = re.search(r"^ *skipped: *(.*)", output, re.M | re.I)
    return found[1] if found else ""


# ---- suites of GoogleTest ------------------------------------------------------------------------------


def from_xml(path):
    """Case -> Result of what the program wrote; None where it wrote nothing that can be read."""
    try:
        cases = list(ElementTree.parse(path).getroot().iter("testcase"))
    except (OSError, ElementTree.ParseError):
        return None
    results = {}
    for case in cases:
        name, skipped = case.get("name") or "set-up or tear-down", case.find("skipped")
        if case.find("failure") is not None:
            results[name] = Result(name, "failed", "")
        elif skipped is not None or case.get("status") == "notrun":
            reason = "disabled" if skipped is None else skipped.get("message", "").strip().split("\n")[-1]
            results[name] = Result(name, "skipped", reason)
        else:
            results[name] = Result(name, "passed", "")
    return results


def from_output(output, suite):
    """The same of what it printed before it ended."""
    words = {"OK": "passed", "FAILED": "failed", "SKIPPED": "skipped"}
    results = {}
    for word, name in re.findall(rf"^\[ +(RUN|OK|FAILED|SKIPPED) +\] {re.escape(suite)}\.(\S+?),?(?: .*)?$", output,
                                 re.M):
        if word == "RUN":
            results[name] = Result(name, "failed", "did not end")
        else:
            results[name] = Result(name, words[word], "")
    return results


def suite_results(test, known, written):
    """Of each case of a suite; at least one has failed where ctest says that the program has."""
    said = from_xml(written)
    results = from_output(output_of(test), known["suite"]) if said is None else dict(said)
    for case in known["cases"]:
        results.setdefault(case, Result(case, "failed", "did not run"))
    if ctest_outcome(test) != "passed" and not any(r.outcome == "failed" for r in results.values()):
        results[""] = Result("the program", "failed", "ended in failure after its cases passed")
    return [r._replace(name=f"{test.get('name')}.{r.name}") for r in results.values()]


# ---- all of a folder -----------------------------------------------------------------------------------


def read(build):
    """(seconds and names of tests, results) of a build folder"""
    try:
        tests = list(ElementTree.parse(build / "results" / "ctest.xml").getroot().iter("testcase"))
    except (OSError, ElementTree.ParseError):
        tests = []
    results = [] if tests else [Result(str(build), "failed", "no result of any test")]
    for test in tests:
        name = test.get("name")
        known = build / "suites" / f"{name}.json"
        if known.exists():
            results += suite_results(test, json.loads(known.read_text(encoding="utf-8")),
                                     build / "results" / "suites" / f"{name}.xml")
        else:
            results.append(Result(name, ctest_outcome(test), skip_reason(output_of(test))))
    return [(float(test.get("time") or 0), test.get("name")) for test in tests], results


def print_parts(lines, out):
    """Lines "SECONDS BUDGET WHAT": what takes more than it may is marked."""
    if not lines:
        return
    print("Builds and runs: seconds, of a budget of", file=out)
    total = collections.Counter()
    for line in lines:
        taken, budget, what = line.split(" ", 2)
        total.update(taken=float(taken), budget=float(budget))
        print(f"  {float(taken):6.0f} {float(budget):6.0f}  {what}" + ("  OVER" if float(taken) > float(budget) else ""),
              file=out)
    print(f"  {total['taken']:6.0f} {total['budget']:6.0f}  together", file=out)


def reasons(path):
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    return dict(line.split(": ", 1) for line in lines if line and not line.startswith("#"))


def print_long(times, why, out):
    """times: (seconds, build folder, name of a test)"""
    long = sorted((t for t in times if t[0] > LONG), reverse=True)
    if long:
        print(f"Tests of more than {LONG} s, and why they take that long", file=out)
    for seconds, build, name in long:
        print(f"  {seconds:7.1f} s  {build}: {name}: {why.get(name, 'NO REASON in tests/slow.txt')}", file=out)


def print_skipped(skipped, out):
    by_reason = collections.defaultdict(list)
    for result in skipped:
        by_reason[result.why or "no reason given"].append(result.name)
    for reason, names in sorted(by_reason.items()):
        more = f" and {len(names) - 1} more" if len(names) > 1 else ""
        print(f"skipped: {names[0]}{more}: {reason}", file=out)


def print_what_passing_tests_say(build, out):
    """What unchanged.py says of tests that passed, and web/test/run.sh of those that did so when they ran again: ctest
    shows what a test printed only if it failed."""
    try:
        tests = ElementTree.parse(build / "results" / "ctest.xml").iter("testcase")
    except (OSError, ElementTree.ParseError):
        return
    for text in (test.findtext("system-out") or "" for test in tests):
        for line in re.findall(r"^(for tests/unchanged[.]txt: \S+ [0-9a-f]{32}|failed at first: .+)$", text, re.M):
            print(line, file=out)


def summarise(builds, parts, out, why=None):
    """Prints to `out`; whether nothing failed. `parts`: lines "SECONDS BUDGET WHAT"; `why`: reasons()."""
    times, results = [], []
    for build in map(pathlib.Path, builds):
        of_tests, of_cases = read(build)
        print_what_passing_tests_say(build, out)
        times += [(taken, build.name, name) for taken, name in of_tests]
        results += [r._replace(name=f"{build.name}: {r.name}") for r in of_cases]
    print_parts(parts, out)
    print_long(times, why or {}, out)
    print_skipped([r for r in results if r.outcome == "skipped"], out)
    failed = [r for r in results if r.outcome == "failed"]
    for result in failed:
        print(f"failed: {result.name}" + (f": {result.why}" if result.why else ""), file=out)
    count = collections.Counter(r.outcome for r in results)
    # A folder without results is no test that failed.
    count["failed"] -= sum(r.why == "no result of any test" for r in failed)
    print(", ".join(f"{count[what]} {what}" for what in ("passed", "failed", "skipped")), file=out)
    return not failed


# ---- self-test -----------------------------------------------------------------------------------------

CTEST = """<?xml version="1.0" encoding="UTF-8"?>
<testsuite name="Linux-c++" tests="5" failures="1" disabled="0" skipped="1">
<testcase name="a" classname="a" time="0.5" status="run"/>
<testcase name="b" classname="b" time="0.1" status="notrun">
<skipped message="SKIP_RETURN_CODE=77"/><system-out>  SKIPPED: no wine</system-out></testcase>
<testcase name="c" classname="c" time="0.1" status="notrun">
<skipped message="SKIP_REGULAR_EXPRESSION_MATCHED"/></testcase>
{more}</testsuite>
"""
SUITE = '<testcase name="io/S" time="21" status="{status}"><system-out>{output}</system-out></testcase>'
CASES = """<testsuites><testsuite name="S"><testcase name="A" status="run" result="completed"/>
<testcase name="B/0" status="run" result="skipped"><skipped message="s.cc:3&#x0A;no device"/></testcase>
{more}</testsuite></testsuites>"""
PASSES = '<testcase name="C" status="run" result="completed"/>'
FAILS = '<testcase name="C" status="run" result="completed"><failure message="no"/></testcase>'
CRASH = """[ RUN      ] S.A
[       OK ] S.A (0 ms)
[ RUN      ] S.B/0
Segmentation fault"""


def summary_of(folder, more, cases=None):
    """(good, lines) of a build folder with CTEST and more, and one suite's results"""
    import io
    (folder / "results" / "suites" / "io").mkdir(parents=True)
    (folder / "suites" / "io").mkdir(parents=True)
    (folder / "results" / "ctest.xml").write_text(CTEST.format(more=more), encoding="utf-8")
    (folder / "suites" / "io" / "S.json").write_text(
        json.dumps({"program": "p", "suite": "S", "cases": ["A", "B/0", "C"]}), encoding="utf-8")
    if cases is not None:
        (folder / "results" / "suites" / "io" / "S.xml").write_text(cases, encoding="utf-8")
    out = io.StringIO()
    good = summarise([folder], [], out)
    return good, out.getvalue().splitlines()


def self_test():
    import io
    test = '<testcase name="d" status="{}">{}</testcase>'
    disabled, failure = '<skipped message="Disabled"/>', '<failure message=""/>'
    missing = '<skipped message="Unable to find executable"/>'
    passes, fails = SUITE.format(status="run", output=""), SUITE.format(status="fail", output="")
    table = [  # more tests, the suite's results; good, a line, the last line
        ("", None, True, "skipped: #: b: no wine", "1 passed, 0 failed, 2 skipped"),
        (test.format("disabled", disabled), None, True, None, "1 passed, 0 failed, 3 skipped"),
        (test.format("fail", failure), None, False, "failed: #: d", "1 passed, 1 failed, 2 skipped"),
        (test.format("notrun", missing), None, False, None, "1 passed, 1 failed, 2 skipped"),
        (passes, CASES.format(more=PASSES), True, "skipped: #: io/S.B/0: no device", "3 passed, 0 failed, 3 skipped"),
        (fails, CASES.format(more=FAILS), False, "failed: #: io/S.C", "2 passed, 1 failed, 3 skipped"),
        # Failures that no case has: a leak, a suite that sets up nothing, a case that is missing.
        (fails, CASES.format(more=PASSES), False,
         "failed: #: io/S.the program: ended in failure after its cases passed", "3 passed, 1 failed, 3 skipped"),
        (passes, CASES.format(more=PASSES + FAILS.replace('"C"', '""')), False,
         "failed: #: io/S.set-up or tear-down", "3 passed, 1 failed, 3 skipped"),
        (passes, CASES.format(more=""), False, "failed: #: io/S.C: did not run", "2 passed, 1 failed, 3 skipped"),
        # Crashes, one before the first case; results that were never written, although it passed.
        (SUITE.format(status="fail", output=CRASH), None, False, "failed: #: io/S.B/0: did not end",
         "2 passed, 2 failed, 2 skipped"),
        (SUITE.format(status="fail", output=CRASH), "<testsuites>", False, "failed: #: io/S.C: did not run",
         "2 passed, 2 failed, 2 skipped"),
        (fails, None, False, "failed: #: io/S.A: did not run", "1 passed, 3 failed, 2 skipped"),
        (passes, None, False, "failed: #: io/S.A: did not run", "1 passed, 3 failed, 2 skipped"),
        ('<testcase name="d" time="1" status="run"><system-out>passed\nfor tests/unchanged.txt: d ' + "0a" * 16 +
         "\n</system-out></testcase>", None, True, "for tests/unchanged.txt: d " + "0a" * 16,
         "2 passed, 0 failed, 2 skipped"),
        ('<testcase name="d" time="1" status="run"><system-out>failed at first: a &lt;page>\nok</system-out></testcase>', None,
         True, "failed at first: a <page>", "2 passed, 0 failed, 2 skipped")]
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        for number, (more, cases, good, line, last) in enumerate(table):
            got, lines = summary_of(folder / str(number), more, cases)
            assert (got, lines[-1]) == (good, last), (number, lines)
            assert line is None or line.replace("#", str(number)) in lines, (number, lines)
        out = io.StringIO()
        parts = ["12 10 build release", "3 5 all tests"]
        assert not summarise([folder / "2", folder / "4"], parts, out, {"io/S": "it counts to a million"})
        lines = out.getvalue().splitlines()
        assert lines[1:4] == ["      12     10  build release  OVER", "       3      5  all tests",
                              "      15     15  together"], lines
        assert lines[5] == "     21.0 s  4: io/S: it counts to a million", lines
        assert lines[-1] == "4 passed, 1 failed, 5 skipped", lines
        out = io.StringIO()
        assert not summarise([folder / "none"], [], out), "no results are no success"
        assert out.getvalue().endswith("none: no result of any test\n0 passed, 0 failed, 0 skipped\n")
    print("summary: self-test passed")


def main(arguments):
    if arguments == ["--self-test"]:
        self_test()
        return 0
    parts = []
    if arguments[:1] == ["--seconds"]:
        parts = pathlib.Path(arguments[1]).read_text(encoding="utf-8").splitlines()
        arguments = arguments[2:]
    why = reasons(pathlib.Path(__file__).parent / "slow.txt")
    return 0 if summarise(arguments, parts, sys.stdout, why) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

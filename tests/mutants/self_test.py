# SPDX-License-Identifier: Apache-2.0
"""The runner on a toy project: each outcome that it knows, in folders of its own."""
import contextlib
import io
import pathlib
import shutil
import tempfile

import run

PROJECT = {
    "CMakeLists.txt": """cmake_minimum_required(VERSION 3.25)
project(toy C)
set(CMAKE_RUNTIME_OUTPUT_DIRECTORY ${PROJECT_BINARY_DIR}/bin)
include_directories(${PROJECT_SOURCE_DIR})
add_library(toy STATIC lib/sum.c)
add_executable(toy_test tests/test.c)
target_link_libraries(toy_test PRIVATE toy)
""",
    "lib/sum.h": """#define FIRST 2
int sum(int a, int b);
""",
    "lib/sum.c": """#include "lib/sum.h"
int sum(int a, int b) {
  int total = a;
  total += b;
  return total;
}
""",
    "tests/test.c": """#include <stdio.h>
#include <string.h>
#include "lib/sum.h"
int main(int argc, char** argv) {
  if (argc > 2 && strstr(argv[2], "Missing")) {
    puts("[==========] Running 0 tests from 0 test suites.");
    return 0;
  }
  return sum(FIRST, 2) == 4 ? 0 : 1;
}
""",
}

HEADER = """file: lib/sum.h
-#define FIRST 2
+#define FIRST 3"""


def becomes(*lines, old="-  total += b;"):
    return "\n".join(["file: lib/sum.c", old, *lines])


# name -> (test line, its change, outcome, in the words of the reason)
CASES = {
    "a_kill": ("toy_test", becomes("+  total -= b;"), run.KILLED, "exit status 1"),
    "b_equivalent": ("toy_test", becomes("+  total += b; // no change"), run.SURVIVED, ""),
    "c_header": ("toy_test", HEADER, run.KILLED, "exit status 1"),
    "d_away": ("toy_test", becomes(old="   int total = c;\n-  total += b;"), run.NOT_APPLIED,
               "found 0 times"),
    "e_syntax": ("toy_test", becomes("+  total +="), run.NOT_BUILT, "log"),
    "f_no_such_test": ("toy_test Missing.*", becomes("+  total -= b;"), run.NOT_SOUND,
                       "there is no such test"),
    "g_endless": ("toy_test", becomes("+  while (total < 1000) total = b;"), run.KILLED, "no end"),
    "h_two_tests": ("toy_test\ntest: toy_test Case.*", becomes(), run.KILLED, "exit status 1"),
}


def expect(truth, what):
    if not truth:
        raise AssertionError(what)


def run_toy(root, names, jobs):
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        status = run.run(root / "tree", root / "list.txt", root / "work", names, jobs)
    return status, out.getvalue()


def row(text, name):
    """The line of the table, which is the last that begins with the name."""
    return [line for line in text.split("\n") if line.startswith(name + " ")][-1]


def check_outcomes(root):
    for jobs in (1, 3):
        shutil.rmtree(root / "work", ignore_errors=True)
        status, text = run_toy(root, [], jobs)
        expect(status == 1, "survivors, and an exit status of 0")
        for name, (_, _, outcome, why) in CASES.items():
            line = row(text, name)
            expect(outcome in line and why in line, f"{jobs} at a time, wanted {outcome} ({why}): {line}")
    # Resumed: what was decided is not done again, the rest is.
    status, text = run_toy(root, [], 1)
    decided = sum(c[2] in (run.KILLED, run.SURVIVED) for c in CASES.values())
    expect(f"{len(CASES)} mutants, {decided} known from before" in text, text)
    expect(run.SURVIVED in row(text, "b_equivalent") and status == 1, text)
    # Nothing but kills: success, without a build.
    status, text = run_toy(root, ["a_kill", "c_header"], 1)
    expect(status == 0 and "built" not in text, text)
    # The tree changes: nothing is known any more.
    source = root / "tree/tests/test.c"
    source.write_text(source.read_text() + "// more\n")
    status, text = run_toy(root, ["a_kill"], 1)
    expect(status == 0 and "0 known from before" in text and "built" in text, text)


def check_check(root):
    def checked(least):
        out = io.StringIO()
        with contextlib.redirect_stdout(out):
            status = run.check(root / "list.txt", root / "tree", least)
        return status, out.getvalue()

    status, text = checked(1)
    expect(status == 1 and "d_away: its lines are found 0 times in lib/sum.c" in text, text)
    expect("there is no test toy_test" in text, text)
    write_list(root, {name: ("l4d_toy_test Suite.Case*", *CASES[name][1:])
                      for name in ("a_kill", "c_header")})
    tests = root / "tree/tests/toy"
    tests.mkdir()
    (tests / "toy_test.cc").write_text("TEST(Suite, CaseOne) {}\n")
    expect(checked(2)[0] == 0, checked(2)[1])
    expect(checked(3)[0] == 1, "too few mutants pass")
    (tests / "toy_test.cc").write_text("TEST(Suite, Another) {}\n")
    expect(checked(2)[0] == 1, "a test that is gone passes")


def check_list(root):
    """Lists that say less than they must, or anything else."""
    whole = block("a_kill", *CASES["a_kill"][:2])
    bad = {line: whole.replace(line + "\n", "") for line in whole.split("\n")[:4]}
    bad["-  total += b;"] = whole.replace("-  total += b;\n", "")
    bad["another key"] = whole.replace("test:", "tests:")
    bad["a name twice"] = whole + "\n" + whole
    for what, text in bad.items():
        (root / "list.txt").write_text(text)
        try:
            run.load(root / "list.txt")
        except run.Bad:
            continue
        raise AssertionError(f"a list is read that lacks: {what}")
    (root / "list.txt").write_text("# of which this says what it is\n\n" + whole)
    expect([m.name for m in run.load(root / "list.txt", ["a_kill"])] == ["a_kill"], "a comment")


def block(name, test, change):
    return f"name: {name}\nbreaks: The sum of two numbers.\ntest: {test}\n{change}\n"


def write_list(root, cases):
    (root / "list.txt").write_text(
        "\n".join(block(name, test, change) for name, (test, change, *_) in cases.items()))


def main():
    run.GRACE = 2
    root = pathlib.Path(tempfile.mkdtemp(prefix="l4d-mutants-"))
    try:
        for path, text in PROJECT.items():
            (root / "tree" / path).parent.mkdir(parents=True, exist_ok=True)
            (root / "tree" / path).write_text(text)
        check_list(root)
        write_list(root, CASES)
        check_outcomes(root)
        check_check(root)
    finally:
        shutil.rmtree(root)
    print("mutants: self-test passed")
    return 0

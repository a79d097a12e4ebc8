#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Branch coverage of the reference decoder over the suite.

  coverage.py [--group NAME].. [--all] [-j N]

A branch is an outcome, true or false, of a condition: of if, elif, while, a conditional expression, a filter of a
comprehension, and of the rule that a call of require() checks. The program runs all queries of the suite and prints
the branches that none reaches. --all: those too that are known to be out of reach, with the reason.

Exit status: 0 where all branches are reached or known (unreached.json) and no known one is reached, 1 otherwise.
"""

import argparse
import ast
import builtins
import collections
import contextlib
import importlib.machinery
import io
import json
import multiprocessing
import sys
from pathlib import Path

sys.dont_write_bytecode = True
HERE = Path(__file__).resolve().parent
REFERENCE = HERE / "reference"
KNOWN = HERE / "unreached.json"
NAME = "_outcome_of_branch"
Branch = collections.namedtuple("Branch", "file line column condition outcome")


class Recorder(ast.NodeTransformer):
    """Passes each condition through a function that takes down what came out."""

    def __init__(self, file, source):
        self.file, self.source, self.branches = file, source, []

    def watched(self, test):
        condition = " ".join(ast.get_source_segment(self.source, test).split())
        key = (self.file, test.lineno, test.col_offset)
        self.branches += [Branch(*key, condition, outcome) for outcome in (True, False)]
        call = ast.Call(ast.Name(NAME, ast.Load()), [ast.Constant(key), test], [])
        return ast.copy_location(call, test)

    def visit_test(self, node):
        self.generic_visit(node)
        node.test = self.watched(node.test)
        return node

    visit_If = visit_While = visit_IfExp = visit_test

    def visit_comprehension(self, node):
        self.generic_visit(node)
        node.ifs = [self.watched(test) for test in node.ifs]
        return node

    def visit_Call(self, node):
        self.generic_visit(node)
        if isinstance(node.func, ast.Name) and node.func.id == "require":
            node.args[0] = self.watched(node.args[0])
        return node


def instrumented(path):
    """(tree, branches) of a module"""
    source = Path(path).read_text(encoding="utf-8")
    recorder = Recorder(Path(path).name, source)
    return ast.fix_missing_locations(recorder.visit(ast.parse(source))), recorder.branches


class Loader(importlib.machinery.SourceFileLoader):
    def get_code(self, fullname):
        path = self.get_filename(fullname)
        return compile(instrumented(path)[0], path, "exec", dont_inherit=True)


def finder(folder):
    if folder != str(REFERENCE):
        raise ImportError(folder)
    return importlib.machinery.FileFinder(folder, (Loader, [".py"]))


def begin():
    """Of a process: the modules of the reference decoder are loaded with their conditions watched."""
    reached = set()

    def outcome(key, value):
        reached.add((*key, bool(value)))
        return value
    setattr(builtins, NAME, outcome)
    sys.path_hooks.insert(0, finder)
    sys.path.insert(0, str(REFERENCE))
    begin.reached = reached


def reached_by(asked):
    """Runs one vector's queries. Returns what was not reached before in this process."""
    import l4d                          # found by the loader above
    before = len(begin.reached)
    path, queries = asked
    for arguments in queries:
        with contextlib.redirect_stdout(io.StringIO()):
            l4d.main([*arguments, path])
    return set(begin.reached) if len(begin.reached) > before else set()


def run(vectors, jobs):
    asked = [(str(HERE / v["file"]), [q["arguments"] for q in v["queries"]]) for v in vectors]
    with multiprocessing.Pool(jobs, begin) as pool:
        return set().union(*pool.imap_unordered(reached_by, asked))


def main(arguments):
    parser = argparse.ArgumentParser(usage=__doc__)
    parser.add_argument("--group", action="append")
    parser.add_argument("--all", action="store_true")
    parser.add_argument("-j", type=int)
    args = parser.parse_args(arguments)
    suite = json.loads((HERE / "suite.json").read_text(encoding="utf-8"))
    known = json.loads(KNOWN.read_text(encoding="utf-8"))
    branches = [b for path in sorted(REFERENCE.glob("*.py")) for b in instrumented(path)[1]]
    reached = run([v for v in suite["vectors"] if not args.group or v["group"] in args.group], args.j)
    left = [b for b in branches if (b.file, b.line, b.column, b.outcome) not in reached]
    reasons = {(k["file"], k["condition"], k["outcome"]): k["why"] for k in known}
    reason = lambda b: next((reasons[key] for key in ((b.file, b.condition, b.outcome), (b.file, "*", b.outcome))
                             if key in reasons), None)
    new = [b for b in left if reason(b) is None]
    for b in left if args.all else new:
        why = reason(b)
        print(f"{b.file}:{b.line}: never {str(b.outcome).lower()}: {b.condition}" + (f"  ({why})" if why else ""))
    print(f"{len(branches) - len(left)} of {len(branches)} branches reached, {len(left) - len(new)} known to be out of "
          f"reach, {len(new)} not reached")
    stale = [] if args.group else [k for k in known if k["condition"] != "*" and not any(
        (b.file, b.condition, b.outcome) == (k["file"], k["condition"], k["outcome"]) for b in left)]
    for k in stale:
        print(f"unreached.json: {k['file']}: {k['condition']}: is reached or gone")
    return 1 if new or stale else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

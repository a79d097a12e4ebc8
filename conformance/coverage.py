#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Branch coverage of the reference decoder over the suite.

  coverage.py [--group NAME].. [--all] [-j N]

A branch is an outcome, true or false, of a condition: of if, elif, while, a conditional expression, a filter of a
comprehension, and of the rule that a call of require() checks. The program runs all queries of the suite and prints
the branches that none reaches. --all: those too that are known to be out of reach, with the reason. Queries of a
vector share a decoder and the pages that it decodes.

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
NAME = "_outcomes_of_"                # and the name of the module: a list of Outcomes
Branch = collections.namedtuple("Branch", "file line column condition outcome")


class Outcomes(dict):
    """Of a condition: whether it failed -> whether it held, for what came out. A lookup costs less than a call."""

    def __missing__(self, failed):
        self[failed] = not failed
        return not failed


class Recorder(ast.NodeTransformer):
    """Looks up each condition in Outcomes, which keep what came out."""

    def __init__(self, file, source):
        self.file, self.source, self.branches = file, source, []

    def watched(self, test):
        condition = " ".join(ast.get_source_segment(self.source, test).split())
        of_file, index = ast.Name(NAME + Path(self.file).stem, ast.Load()), ast.Constant(len(self.branches) // 2)
        self.branches += [Branch(self.file, test.lineno, test.col_offset, condition, outcome)
                          for outcome in (True, False)]
        of_condition = ast.Subscript(of_file, index, ast.Load())
        return ast.copy_location(ast.Subscript(of_condition, ast.UnaryOp(ast.Not(), test), ast.Load()), test)

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
        tree, branches = instrumented(path)
        outcomes = [Outcomes() for _ in branches[::2]]
        setattr(builtins, NAME + Path(path).stem, outcomes)
        begin.watched += zip(branches[::2], outcomes)
        return compile(tree, path, "exec", dont_inherit=True)


def finder(folder):
    if folder != str(REFERENCE):
        raise ImportError(folder)
    return importlib.machinery.FileFinder(folder, (Loader, [".py"]))


def begin():
    """Of a process: the modules of the reference decoder are loaded with their conditions watched."""
    begin.watched, begin.before, begin.decoder = [], 0, None
    sys.path_hooks.insert(0, finder)
    sys.path.insert(0, str(REFERENCE))
    import l4d                          # found by the loader above

    class Decoder(l4d.Decoder):
        def __init__(self, data):
            super().__init__(data)
            self.known = {}
            begin.decoder = self

        def page_and_attributes(self, selected, base_only=False):
            key = (selected.index, selected.record["offset"], base_only)
            if key not in self.known:
                self.known[key] = super().page_and_attributes(selected, base_only)
            page, attributes = self.known[key]
            return page, dict(attributes)
    l4d.Decoder = lambda data: begin.decoder or Decoder(data)


def reached_by(asked):
    """Runs one vector's queries. Returns what this process has reached, if that is more than before."""
    import l4d
    path, queries = asked
    begin.decoder = None
    for arguments in queries:
        with contextlib.redirect_stdout(io.StringIO()):
            l4d.main([*arguments, path])
    now = sum(len(outcomes) for _, outcomes in begin.watched)
    if now == begin.before:
        return set()
    begin.before = now
    return {(b.file, b.line, b.column, held) for b, outcomes in begin.watched for held in outcomes.values()}


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

#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Runs a decoder through the conformance suite and prints where it stands.

  run.py [OPTIONS] -- DECODER [ARGUMENT...]

  --suite FILE         the suite (default: suite.json beside this program)
  --profile NAME       claim: indexed, main, lossless or any (default)
  --level N            claim: conformance levels 1 to N; 0 = streams of any size (default)
  --without FEATURE    no claim to: packed, base, validate, demand; may be repeated
  --only TEXT          vectors whose name contains the text; may be repeated
  --group NAME         vectors of one group; may be repeated
  -j N                 that many decoders at once (default: one per core)
  --timeout SECONDS    for one query (default: 300)
  --adapter FILE       a Python file whose answer_of(command, arguments, path, timeout) asks the decoder in place of the
                       contract and returns (exit status, output, errors): no process for each adapter
  --json FILE          writes all results
  --junit FILE         writes them as JUnit does
  --quiet              no matrix

The contract is in README.md. Exit status: 0 all passed, 1 some failed, 2 usage. Nothing but Python's standard
library and the files of the suite is needed.
"""

import argparse
import concurrent.futures
import importlib
import json
import os
import subprocess
import sys
import time
import xml.etree.ElementTree as ET
from pathlib import Path

HERE = Path(__file__).resolve().parent
PROFILES = {"any": None, "indexed": {1}, "main": {1, 2}, "lossless": {3}}
NAMES_OF_PROFILES = {0: "none", 1: "indexed", 2: "main", 3: "lossless"}
FEATURES = ("packed", "base", "validate", "demand")
PASSED, FAILED, SKIPPED = "passed", "failed", "skipped"


class Result:
    """Of one query of one vector."""

    def __init__(self, vector, query):
        self.vector, self.query = vector, query
        self.outcome, self.why, self.seconds, self.answer, self.named = FAILED, "", 0.0, None, False

    def name(self):
        return f"{self.vector['name']} {' '.join(self.query['arguments'])}"

    def is_negative(self):
        return "refused" in self.query


# ---- what is claimed -----------------------------------------------------------------------------

def features_of(query):
    arguments = query["arguments"]
    return {name for name, used in (
        ("packed", "--packed" in arguments), ("base", "base" in arguments),
        ("validate", "validate" in arguments), ("demand", "demand" in arguments)) if used}


def is_claimed(vector, profile, level):
    """A faulty vector of which nobody knows the profile or the level concerns every decoder."""
    unknown = vector["group"] == "faulty" and 0 in (vector["profile"], vector["level"])
    wanted = PROFILES[profile]
    fits = wanted is None or vector["profile"] in wanted
    return unknown or fits and (level == 0 or 0 < vector["level"] <= level)


def chosen(suite, args):
    for vector in suite["vectors"]:
        if args.group and vector["group"] not in args.group:
            continue
        if args.only and not any(text in vector["name"] for text in args.only):
            continue
        if is_claimed(vector, args.profile, args.level):
            yield from (Result(vector, q) for q in vector["queries"]
                        if not features_of(q) & set(args.without))


# ---- one query -----------------------------------------------------------------------------------

def answer_of(command, arguments, path, timeout):
    """What the decoder says: exit status, output, errors."""
    done = subprocess.run([*command, *arguments, path], capture_output=True, timeout=timeout, check=False)
    return done.returncode, done.stdout, done.stderr


def loaded(path):
    """answer_of of an adapter. Its name is known to processes that it starts."""
    sys.path.insert(0, str(path.resolve().parent))
    return importlib.import_module(path.stem).answer_of


def run(result, ask, command, folder, timeout):
    path = str(folder / result.vector["file"])
    begin = time.monotonic()
    try:
        judge(result, *ask(command, result.query["arguments"], path, timeout))
    except subprocess.TimeoutExpired:
        result.why = f"no answer after {timeout} s"
    except OSError as error:
        result.why = f"the decoder does not run: {error}"
    result.seconds = time.monotonic() - begin
    return result


def judge(result, status, out, err):
    """Sets the outcome and, where it is not `passed`, why."""
    if status not in (0, 1):
        words = err.decode("utf-8", "replace").strip().splitlines()
        result.why = f"exit status {status}" + (f": {words[-1]}" if words else "")
        return
    try:
        answer = json.loads(out)
    except ValueError:
        result.why = f"its output is not one JSON object: {out[:80]!r}"
        return
    result.answer = answer
    if not isinstance(answer, dict):
        result.why = "its output is not a JSON object"
    elif "unavailable" in answer:
        result.outcome, result.why = SKIPPED, f"unavailable: {answer['unavailable']}"
    elif ("refused" in answer) != (status == 1):
        result.why = f"exit status {status} does not go with the answer {sorted(answer)}"
    elif result.is_negative():
        judge_refusal(result, answer)
    else:
        judge_answer(result, answer)


def judge_refusal(result, answer):
    query, said = result.query, answer.get("refused")
    result.named = said in query["refused"]
    if said is None:
        result.why = f"accepted; it breaks {query['refused'][0]}"
    elif result.named or said in query["kinds"]:
        result.outcome = PASSED
    else:
        result.why = f"refused for {said}, not for {' or '.join(query['refused'])}"


def judge_answer(result, answer):
    query = result.query
    if "refused" in answer:
        is_limit = answer["refused"] == "limit"
        result.outcome = SKIPPED if is_limit else FAILED
        result.why = f"refused for {answer['refused']}; it breaks no rule"
        return
    wrong = []
    for key in ("valid", "num_gaussians"):
        if key in query and answer.get(key) != query[key]:
            wrong.append(f"{key} is {answer.get(key)}, not {query[key]}")
    for key, value in query.get("demand", {}).items():
        got = answer.get("demand", {}).get(key)
        if got != value:
            wrong.append(f"{key} is {got}, not {value}")
    if "digests" in query:
        got = answer.get("digests") or {}
        wrong += [f"{key} differs" for key, value in query["digests"].items()
                  if (key == "all" or key in got) and got.get(key) != value]
    result.outcome, result.why = (FAILED, "; ".join(wrong)) if wrong else (PASSED, "")


# ---- reports -------------------------------------------------------------------------------------

def count(results):
    return [sum(r.outcome == o for r in results) for o in (PASSED, FAILED, SKIPPED)]


def table(title, rows):
    width = max([len(title), *(len(name) for name, _ in rows)])
    print(f"\n{title:<{width}}  passed  failed skipped")
    for name, results in rows:
        passed, failed, skipped = count(results)
        print(f"{name:<{width}}  {passed:6}  {failed:6}  {skipped:6}" + ("  <--" if failed else ""))


def by_clause(results):
    """clause -> (results of legal vectors, results of faulty ones)"""
    out = {}
    for r in results:
        for clause in r.query["refused"][:1] if r.is_negative() else r.vector["clauses"]:
            out.setdefault(clause, ([], []))[r.is_negative()].append(r)
    return out


def matrix(results):
    print("\nclause    legal vectors   faulty vectors   named")
    for clause, (legal, faulty) in sorted(by_clause(results).items(), key=lambda c: clause_key(c[0])):
        cells = ["{}/{}".format(count(part)[0], len(part) - count(part)[2]) if part else "-"
                 for part in (legal, faulty)]
        named = f"{sum(r.named for r in faulty)}/{len(faulty)}" if faulty else "-"
        bad = any(r.outcome == FAILED for r in legal + faulty)
        print(f"{clause:<9} {cells[0]:>13} {cells[1]:>16} {named:>7}" + ("  <--" if bad else ""))
    grouped = lambda key: [(name, [r for r in results if key(r) == name])
                           for name in sorted({key(r) for r in results})]
    table("profile", grouped(lambda r: NAMES_OF_PROFILES[r.vector["profile"]]))
    table("level", grouped(lambda r: str(r.vector["level"] or "none")))
    table("group", grouped(lambda r: r.vector["group"]))
    table("query", grouped(lambda r: " ".join(sorted(features_of(r.query))) or
                           r.query["arguments"][1].partition(":")[0]))


def clause_key(clause):
    name, _, number = clause.partition("-")
    return name, int(number or 0)


def write_json(path, results, command, seconds):
    passed, failed, skipped = count(results)
    rows = [{"vector": r.vector["name"], "arguments": r.query["arguments"], "outcome": r.outcome, "why": r.why,
             "answer": r.answer, "seconds": round(r.seconds, 3)} for r in results]
    clauses = {c: {"legal": count(a)[:2], "faulty": count(b)[:2]} for c, (a, b) in by_clause(results).items()}
    Path(path).write_text(json.dumps({"decoder": command, "passed": passed, "failed": failed,
                                      "skipped": skipped, "seconds": round(seconds, 1), "clauses": clauses,
                                      "results": rows}, indent=1) + "\n", encoding="utf-8")


def write_junit(path, results, seconds):
    _, failed, skipped = count(results)
    root = ET.Element("testsuite", name="l4d-conformance", tests=str(len(results)), failures=str(failed),
                      skipped=str(skipped), time=f"{seconds:.1f}")
    for r in results:
        case = ET.SubElement(root, "testcase", classname=r.vector["name"].replace("/", "."),
                             name=" ".join(r.query["arguments"]), time=f"{r.seconds:.3f}")
        if r.outcome != PASSED:
            ET.SubElement(case, "failure" if r.outcome == FAILED else "skipped", message=r.why)
    ET.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


def main(arguments):
    if "--" not in arguments:
        print(__doc__, file=sys.stderr)
        return 2
    split = arguments.index("--")
    command = arguments[split + 1:]
    parser = argparse.ArgumentParser(usage=__doc__)
    parser.add_argument("--suite", type=Path, default=HERE / "suite.json")
    parser.add_argument("--profile", choices=PROFILES, default="any")
    parser.add_argument("--level", type=int, default=0)
    parser.add_argument("--without", choices=FEATURES, action="append", default=[])
    parser.add_argument("--only", action="append")
    parser.add_argument("--group", action="append")
    parser.add_argument("-j", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--timeout", type=float, default=300)
    parser.add_argument("--adapter", type=Path)
    parser.add_argument("--json")
    parser.add_argument("--junit")
    parser.add_argument("--quiet", action="store_true")
    args = parser.parse_args(arguments[:split])
    if not command:
        parser.error("no decoder given")
    suite = json.loads(args.suite.read_text(encoding="utf-8"))
    results = list(chosen(suite, args))
    if not results:
        parser.error("no vector fits")
    ask = loaded(args.adapter) if args.adapter else answer_of
    begin = time.monotonic()
    with concurrent.futures.ThreadPoolExecutor(max(args.j, 1)) as pool:
        list(pool.map(lambda r: run(r, ask, command, args.suite.resolve().parent, args.timeout), results))
    seconds = time.monotonic() - begin
    for r in results:
        if r.outcome == FAILED:
            print(f"FAIL {r.name()}: {r.why}")
    if not args.quiet:
        matrix(results)
    if args.json:
        write_json(args.json, results, command, seconds)
    if args.junit:
        write_junit(args.junit, results, seconds)
    passed, failed, skipped = count(results)
    print(f"\n{len({r.vector['name'] for r in results})} vectors, {len(results)} queries, {skipped} skipped, "
          f"{seconds:.1f} s; claim: profile {args.profile}, level {args.level or 'any'}"
          + "".join(f", without {f}" for f in args.without))
    print(f"{passed} passed, {failed} failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

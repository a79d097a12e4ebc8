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

The contract is in README.md. While it runs, a line every few seconds on standard error says how far it is.
Exit status: 0 none failed and some passed, 1 otherwise, 2 nothing was run (usage, a suite that is not whole, a
decoder that does not start), 130 interrupted; what was known then is reported. Nothing but Python's standard library
and the files of the suite is needed.
"""

import argparse
import concurrent.futures
import hashlib
import importlib
import json
import math
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import xml.etree.ElementTree as ET
from pathlib import Path

HERE = Path(__file__).resolve().parent
PROFILES = {"any": None, "indexed": {1}, "main": {1, 2}, "lossless": {3}}
NAMES_OF_PROFILES = {0: "none", 1: "indexed", 2: "main", 3: "lossless"}
FEATURES = ("packed", "base", "validate", "demand")
PASSED, FAILED, SKIPPED = "passed", "failed", "skipped"
HIGHEST_LEVEL = 6
MOST_OUTPUT = 1 << 20  # bytes of an answer
MOST_TIMEOUT = 1e6
PROGRESS_SECONDS = 5


class Result:
    """Of one query of one vector."""

    def __init__(self, vector, query):
        self.vector, self.query = vector, query
        self.outcome, self.why, self.seconds, self.answer, self.named = FAILED, "", 0.0, None, False
        self.done = False

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

class Running:
    """The decoders at work. They and what they start are ended together."""

    def __init__(self):
        self.lock, self.groups, self.stopped = threading.Lock(), set(), False

    def add(self, process):
        with self.lock:
            self.groups.add(process.pid)
            if self.stopped:
                self.end(process.pid)

    def remove(self, process):
        """What the decoder left behind ends with it."""
        with self.lock:
            self.groups.discard(process.pid)
            self.end(process.pid)

    def stop(self):
        with self.lock:
            self.stopped = True
            for group in self.groups:
                self.end(group)

    @staticmethod
    def end(group):
        try:
            os.killpg(group, signal.SIGKILL)
        except (AttributeError, OSError):
            pass  # it has ended, or this system has no groups


RUNNING = Running()


def answer_of(command, arguments, path, timeout):
    """What the decoder says: exit status, output, errors, of both no more than is of use."""
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        process = subprocess.Popen([*command, *arguments, path], stdin=subprocess.DEVNULL, stdout=out, stderr=err,
                                   start_new_session=True)
        RUNNING.add(process)
        try:
            status = process.wait(timeout)
        finally:
            RUNNING.remove(process)
            process.wait()
        size = err.seek(0, os.SEEK_END)
        err.seek(max(0, size - MOST_OUTPUT))
        out.seek(0)
        return status, out.read(MOST_OUTPUT + 1), err.read()


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
    except Exception as error:  # an answer of any kind is the decoder's, and must not end the run
        result.why = f"its answer cannot be judged: {type(error).__name__}: {error}"
    result.seconds = time.monotonic() - begin
    result.done = True
    return result


def name_of(status):
    """An exit status, or the signal that ended the process."""
    try:
        return f"ended by {signal.Signals(-status).name}" if status < 0 else f"exit status {status}"
    except ValueError:
        return f"exit status {status}"


def judge(result, status, out, err):
    """Sets the outcome and, where it is not `passed`, why."""
    if status not in (0, 1):
        words = err.decode("utf-8", "replace").strip().splitlines()
        result.why = name_of(status) + (f": {words[-1][:200]}" if words else "")
        return
    if len(out) > MOST_OUTPUT:
        result.why = f"its output is longer than {MOST_OUTPUT} bytes"
        return
    try:
        answer = json.loads(out)
    except (ValueError, RecursionError):
        result.why = f"its output is not one JSON object: {out[:80]!r}"
        return
    result.answer = answer
    if not isinstance(answer, dict):
        result.why = "its output is not a JSON object"
    elif malformed(answer):
        result.why = malformed(answer)
    elif "unavailable" in answer:
        result.outcome, result.why = SKIPPED, f"unavailable: {answer['unavailable']}"
    elif ("refused" in answer) != (status == 1):
        result.why = f"exit status {status} does not go with the answer {sorted(answer)}"
    elif result.is_negative():
        judge_refusal(result, answer)
    else:
        judge_answer(result, answer)


def malformed(answer):
    """What of an answer has another type than the contract says, or None."""
    types = {"refused": str, "num_gaussians": int, "digests": dict, "demand": dict, "valid": bool}
    for key, wanted in types.items():
        is_number = wanted is int and isinstance(answer.get(key), bool)
        if key in answer and (not isinstance(answer[key], wanted) or is_number):
            return f"{key} is {json.dumps(answer[key])[:60]}"
    return None


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


def write_file(path, data):
    """Replaces a file as a whole; writes into what is no file, such as a pipe."""
    if path.exists() and not path.is_file():
        path.write_bytes(data)
        return
    part = path.with_name(path.name + ".part")
    part.write_bytes(data)
    os.replace(part, path)


def write_json(path, results, command, seconds):
    passed, failed, skipped = count(results)
    rows = [{"vector": r.vector["name"], "arguments": r.query["arguments"], "outcome": r.outcome, "why": r.why,
             "answer": r.answer, "seconds": round(r.seconds, 3)} for r in results]
    clauses = {c: {"legal": count(a)[:2], "faulty": count(b)[:2]} for c, (a, b) in by_clause(results).items()}
    write_file(path, json.dumps({"decoder": command, "passed": passed, "failed": failed,
                                      "skipped": skipped, "seconds": round(seconds, 1), "clauses": clauses,
                                      "results": rows}, indent=1).encode() + b"\n")


def write_junit(path, results, seconds):
    _, failed, skipped = count(results)
    root = ET.Element("testsuite", name="l4d-conformance", tests=str(len(results)), failures=str(failed),
                      skipped=str(skipped), time=f"{seconds:.1f}")
    for r in results:
        case = ET.SubElement(root, "testcase", classname=r.vector["name"].replace("/", "."),
                             name=" ".join(r.query["arguments"]), time=f"{r.seconds:.3f}")
        if r.outcome != PASSED:
            ET.SubElement(case, "failure" if r.outcome == FAILED else "skipped", message=r.why)
    write_file(path, ET.tostring(root, encoding="utf-8", xml_declaration=True))


def report(results, args, command, seconds):
    """Prints and writes what is known. Returns whether all of it could be written."""
    for r in results:
        if r.outcome == FAILED and r.done:
            print(f"FAIL {r.name()}: {r.why}")
    done = [r for r in results if r.done]
    if not args.quiet and done:
        matrix(done)
    written = True
    for path, write in ((args.json, lambda to: write_json(to, done, command, seconds)),
                        (args.junit, lambda to: write_junit(to, done, seconds))):
        if path is None:
            continue
        try:
            write(path)
        except OSError as error:
            print(f"run.py: {path}: {error.strerror}", file=sys.stderr)
            written = False
    passed, failed, skipped = count(done)
    print(f"\n{len({r.vector['name'] for r in done})} vectors, {len(done)} queries, {skipped} skipped, "
          f"{seconds:.1f} s; claim: profile {args.profile}, level {args.level or 'any'}"
          + "".join(f", without {f}" for f in args.without))
    if len(done) < len(results):
        print(f"interrupted: {len(results) - len(done)} queries were not run")
    elif failed or skipped or not passed:
        print(f"the claim does not hold: {failed} failed, {skipped} skipped")
    else:
        print("the claim holds for these vectors")
    print(f"{passed} passed, {failed} failed")
    return written


def damaged(results, folder):
    """The vectors that are not the files of the suite, and why."""
    out = []
    for vector in {r.vector["name"]: r.vector for r in results}.values():
        path = folder / vector["file"]
        try:
            data = path.read_bytes()
        except OSError as error:
            out.append(f"{path}: {error.strerror}")
            continue
        if hashlib.sha256(data).hexdigest() != vector["sha256"]:
            out.append(f"{path}: {len(data)} bytes, which are not those of the suite")
    return out


def run_all(results, ask, command, folder, args):
    """Runs all queries. Returns False where that was interrupted."""
    # An exception could come while a lock is held, and leave all threads waiting for it.
    interrupted = threading.Event()
    before = signal.signal(signal.SIGINT, lambda *_: interrupted.set())
    shown = time.monotonic()
    try:
        with concurrent.futures.ThreadPoolExecutor(args.j) as pool:
            pending = {pool.submit(run, r, ask, command, folder, args.timeout) for r in results}
            while pending and not interrupted.is_set():
                _, pending = concurrent.futures.wait(pending, 0.5, concurrent.futures.FIRST_COMPLETED)
                if pending and time.monotonic() - shown > PROGRESS_SECONDS:
                    shown = time.monotonic()
                    _, failed, _ = count([r for r in results if r.done])
                    print(f"{len(results) - len(pending)} of {len(results)} queries, {failed} failed",
                          file=sys.stderr, flush=True)
            if not pending:
                return True
            known = {id(r) for r in results if r.done}
            for future in pending:
                future.cancel()
            RUNNING.stop()
            concurrent.futures.wait(pending)
            for r in results:  # those that were ended just now answered nothing
                r.done = id(r) in known
            return False
    finally:
        signal.signal(signal.SIGINT, before)


def positive_seconds(text):
    value = float(text)
    if not (math.isfinite(value) and 0 < value <= MOST_TIMEOUT):
        raise argparse.ArgumentTypeError(f"is not above 0 and at most {MOST_TIMEOUT:.0f}")
    return value


def arguments_of(given):
    """The arguments, the command of the decoder, and the suite; ends the program where they are of no use."""
    parser = argparse.ArgumentParser(prog="run.py", add_help=False, usage="run.py [OPTIONS] -- DECODER [ARGUMENT...]; "
                                     "run.py --help lists the options")
    parser.add_argument("--suite", type=Path, default=HERE / "suite.json")
    parser.add_argument("--profile", choices=PROFILES, default="any")
    parser.add_argument("--level", type=int, choices=range(HIGHEST_LEVEL + 1), default=0)
    parser.add_argument("--without", choices=FEATURES, action="append", default=[])
    parser.add_argument("--only", action="append")
    parser.add_argument("--group", action="append")
    parser.add_argument("-j", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--timeout", type=positive_seconds, default=300)
    parser.add_argument("--adapter", type=Path)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--junit", type=Path)
    parser.add_argument("--quiet", action="store_true")
    split = given.index("--") if "--" in given else len(given)
    args, command = parser.parse_args(given[:split]), given[split + 1:]
    if not command:
        parser.error("no decoder given: it comes after --")
    if args.j < 1:
        parser.error("-j is at least 1")
    if args.adapter is None and shutil.which(command[0]) is None:
        parser.error(f"{command[0]} is not a program that can be run (one of this folder is ./{Path(command[0]).name})")
    if args.adapter is not None and not args.adapter.is_file():
        parser.error(f"{args.adapter} is no file")
    for path in (args.json, args.junit):
        if path is not None and (path.is_dir() or not path.resolve().parent.is_dir()):
            parser.error(f"{path} cannot be written")
    try:
        suite = json.loads(args.suite.read_text(encoding="utf-8"))
        groups = sorted({v["group"] for v in suite["vectors"]})
    except OSError as error:
        parser.error(f"{args.suite}: {error.strerror}")
    except (ValueError, KeyError, TypeError):
        parser.error(f"{args.suite} is no suite")
    if args.group and not set(args.group) <= set(groups):
        parser.error(f"the groups are {', '.join(groups)}")
    return args, command, suite, parser


def main(given):
    if {"-h", "--help"} & set(given[:given.index("--") if "--" in given else None]):
        print(__doc__)
        return 0
    args, command, suite, parser = arguments_of(given)
    results = list(chosen(suite, args))
    if not results:
        parser.error("no vector has such a name and fits the claim (--only takes a part of a name, no pattern)")
    folder = args.suite.resolve().parent
    bad = damaged(results, folder)
    if bad:
        print("\n".join(bad[:10]), file=sys.stderr)
        parser.error(f"{len(bad)} files are not those of the suite; was a line end changed in them?")
    ask = loaded(args.adapter) if args.adapter else answer_of
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    begin = time.monotonic()
    complete = run_all(results, ask, command, folder, args)
    written = report(results, args, command, time.monotonic() - begin)
    if not complete:
        return 130
    passed, failed, _ = count(results)
    return 1 if failed or not passed or not written else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

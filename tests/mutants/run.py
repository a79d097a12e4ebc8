#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Mutation tests: do the tests notice that a line of the source is wrong?

mutants.txt lists them. Each changes one line or two of one file, and says what a user would see and
what has to fail:

    name: cache_evicts_newest
    breaks: Stepping through a long scene decodes everything again and again.
    test: l4d_decoder_test CacheBudget.*       a program, and which of its tests (GoogleTest's filter)
    test: cli info                             tests/cli/t_info.sh
    test: spec                                 the independent reader of tests/spec
    file: decoder/session/bucket_cache.cc
    -  the lines that are replaced, whole: found exactly once in the file
    +  the lines in their place
       a line that stays, only where the others are there twice

    run.py [NAME...]       builds a copy of the tree once, then each mutant in a copy of that, several
                           at a time; the tests named must pass without the change and one of them must
                           fail with it. What is known is kept in WORK/results.json and not done again
                           until the tree or the mutant changes.
    run.py --check         every mutant still applies, names tests that exist, changes little
    run.py --self-test     the runner itself, on a toy project

Exit status 0: every mutant was killed. 1: some survived, do not apply, do not build, or name tests
that fail or are missing without them.

Sources lie inside the build folder, so that Ninja's rules name them by relative paths and a copy of
the folder is a build of its own, up to date. A worker puts back what a mutant changed from the
folder that it was copied from, objects and times included."""
import argparse
import hashlib
import json
import os
import pathlib
import queue
import random
import re
import shutil
import subprocess
import sys
import tempfile
import threading
import time

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parent.parent
LIST = HERE / "mutants.txt"
LEFT_OUT = {".git", "build", "shared", "__pycache__"}
KILLED, SURVIVED, NOT_RUN = "killed", "SURVIVED", "not run"
NOT_APPLIED, NOT_BUILT, NOT_SOUND = "does not apply", "does not build", "fails without it"
MOST_CHANGED = 8  # lines of a mutant
GRACE = 60  # seconds beyond ten times what a test takes
MOST_MEMORY = 16 << 30  # of a test: a mutant may forget a limit


class Bad(Exception):
    """A mutant that cannot be used."""


# ---- the list --------------------------------------------------------------------------------------


class Mutant:
    """One block of the list: its fields, then the lines of its change."""

    def __init__(self, block):
        self.text = block
        self.name, self.breaks, self.tests, self.file = "", "", [], ""
        self.old, self.new, self.changed = [], [], 0
        for line in block.split("\n"):
            mark, rest = line[:1], line[1:]
            if self.file and mark in " -+":
                self.old += [rest] if mark != "+" else []
                self.new += [rest] if mark != "-" else []
                self.changed += mark != " "
                continue
            key, _, value = line.partition(": ")
            if self.file or key not in ("name", "breaks", "test", "file") or not value.strip():
                raise Bad(f"{self.name or 'a mutant'}: '{line}' is no line of the list")
            if key == "test":
                self.tests.append(value)
            else:
                setattr(self, key, value)
        if not (self.name and self.breaks and self.tests and self.old and self.changed):
            raise Bad(f"{self.name or block}: wants 'name:', 'breaks:', 'test:', 'file:' and lines")

    def apply(self, tree):
        """The changed file's text. The old lines must be found exactly once, wherever they are."""
        try:
            text = "\n" + (tree / self.file).read_text(encoding="utf-8")
        except OSError:
            raise Bad(f"{self.name}: no file {self.file}") from None
        # Whole lines, so that none is found in the middle of another.
        old, new = ("\n" + "\n".join([*lines, ""]) for lines in (self.old, self.new))
        if text.count(old) != 1:
            raise Bad(f"{self.name}: its lines are found {text.count(old)} times in {self.file}")
        return text.replace(old, new)[1:]

    def targets(self):
        out = []
        for test in self.tests:
            out += targets_of(test)
        return sorted(set(out))


def targets_of(test):
    kind = test.split()[0]
    return {"cli": ["l4dcodec_cli"],
            "spec": ["l4d_spec_dump_values", "l4d_spec_encode_scene"]}.get(kind, [kind])


def command_of(test, folder):
    kind, *rest = test.split()
    if kind == "cli":
        return ["bash", str(folder / "tests/cli/run.sh"), str(folder / "bin/l4dcodec"), *rest]
    if kind == "spec":
        return [sys.executable, "-B", str(folder / "tests/spec/streams_test.py"),
                str(folder / "bin/l4d_spec_dump_values"), str(folder / "bin/l4d_spec_encode_scene")]
    return [str(folder / "bin" / kind), "--gtest_fail_fast",
            *(["--gtest_filter=" + rest[0]] if rest else [])]


def load(listing, names=()):
    """The mutants of a list, or those of them that are named, by name."""
    lines = listing.read_text(encoding="utf-8").split("\n")
    blocks = "\n".join(line for line in lines if not line.startswith("#")).strip("\n").split("\n\n")
    mutants = sorted((Mutant(b) for b in blocks), key=lambda m: m.name)
    known = {m.name for m in mutants}
    if len(known) != len(mutants):
        raise Bad(f"{listing}: two mutants have one name")
    for name in names:
        if name not in known:
            raise Bad(f"no mutant '{name}' in {listing}")
    return [m for m in mutants if not names or m.name in names]


# ---- the check that is cheap ------------------------------------------------------------------------


def missing_tests(test, tree):
    """What a 'test:' line names that the sources do not have."""
    kind, *rest = test.split()
    if kind == "spec":
        return []
    if kind == "cli":
        return [n for n in rest if not (tree / f"tests/cli/t_{n}.sh").exists()]
    found = re.fullmatch(r"l4d_(\w+)_test", kind)
    if not found or not (tree / "tests" / found[1]).is_dir():
        return [kind]
    sources = "".join(p.read_text(encoding="utf-8")
                      for p in sorted((tree / "tests" / found[1]).glob("*.cc")))
    missing = []
    for pattern in (rest[0] if rest else "").split("-")[0].split(":"):
        suite, _, case = pattern.partition(".")
        suite, case = suite.split("/")[-1].strip("*"), case.split("/")[0].strip("*")
        if suite and not re.search(rf"\(\s*\w*{suite}\w*\s*[,)]", sources):
            missing.append(pattern)
        elif case and not re.search(rf",\s*\w*{case}\w*\s*\)", sources):
            missing.append(pattern)
    return missing


def check(listing, tree, least):
    problems, mutants = [], load(listing)
    for mutant in mutants:
        try:
            mutant.apply(tree)
        except Bad as e:
            problems.append(str(e))
            continue
        if mutant.changed > MOST_CHANGED:
            problems.append(f"{mutant.name}: changes {mutant.changed} lines, at most {MOST_CHANGED}")
        for test in mutant.tests:
            problems += [f"{mutant.name}: there is no test {m}" for m in missing_tests(test, tree)]
    if len(mutants) < least:
        problems.append(f"{len(mutants)} mutants, at least {least} are wanted")
    for problem in problems:
        print(problem)
    folders = sorted({m.file.split("/")[0] for m in mutants})
    print(f"{len(mutants)} mutants of {', '.join(folders)}; {len(problems)} problems")
    return 1 if problems else 0


# ---- folders ---------------------------------------------------------------------------------------


def tree_files(tree):
    for folder, folders, files in os.walk(tree):
        relative = pathlib.Path(folder).relative_to(tree)
        left_out = {"__pycache__"} if relative.parts else LEFT_OUT
        folders[:] = sorted(f for f in folders if f not in left_out)
        for name in sorted(files):
            yield relative / name


def fingerprint(tree):
    """Of all that a result may depend on but the mutant."""
    digest = hashlib.sha256()
    for path in tree_files(tree):
        if path.name == LIST.name or path.parts[0] in ("docs", "CHANGELOG.md"):
            continue
        if not (tree / path).is_file():
            continue
        digest.update(str(path).encode() + b"\0" + (tree / path).read_bytes() + b"\0")
    return digest.hexdigest()[:16]


def update_sources(tree, base):
    """Copies what differs, so that times of the rest stay; removes sources that are gone."""
    listing = base / ".sources"
    now = {str(p) for p in tree_files(tree) if (tree / p).is_file()}
    if listing.exists():
        for gone in set(listing.read_text().split("\n")) - now:
            if gone:
                (base / gone).unlink(missing_ok=True)
    for path in sorted(now):
        source, target = tree / path, base / path
        if target.exists() and target.read_bytes() == source.read_bytes():
            continue
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(source, target)
    listing.write_text("\n".join(sorted(now)))


def index(folder):
    """Path -> what tells whether a file was touched."""
    out, stack = {}, [str(folder)]
    while stack:
        for entry in os.scandir(stack.pop()):
            if entry.is_dir(follow_symlinks=False):
                stack.append(entry.path)
            elif entry.is_file(follow_symlinks=False):
                status = entry.stat()
                out[os.path.relpath(entry.path, folder)] = (status.st_size, status.st_mtime_ns)
    return out


def restore(base, folder, wanted):
    have = index(folder)
    for path in have.keys() - wanted.keys():
        os.unlink(folder / path)
    for path, stamp in wanted.items():
        if have.get(path) != stamp:
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            # Not into the old file, which may still be a program that runs.
            (folder / path).unlink(missing_ok=True)
            shutil.copy2(base / path, folder / path)


# ---- building --------------------------------------------------------------------------------------


def relative_rules(base):
    """Rewrites build.ninja so that it is right in any copy of the folder."""
    for name in ("build.ninja", "CMakeFiles/rules.ninja"):
        path = base / name
        lines, skipping = [], False
        for line in path.read_text().split("\n"):
            if line.startswith("build ") and re.search(r": (RERUN_CMAKE|VERIFY_GLOBS)\b", line):
                skipping = True  # a copy must not configure the original again
                continue
            if skipping and line.startswith("  "):
                continue
            skipping = False
            if re.match(r"  (INCLUDES|FLAGS|DEFINES|LINK_LIBRARIES|LINK_FLAGS|LINK_PATH) = ", line):
                line = re.sub(rf"{re.escape(str(base))}(?=[/\s\"]|$)", ".", line)
            elif line.startswith("build "):
                line = line.replace(f"{base}/", "")
            elif line.startswith("  POST_BUILD = "):
                line = "  POST_BUILD = :"  # lists tests for ctest
            lines.append(line)
        path.write_text("\n".join(lines))


def run_logged(command, log, **more):
    with open(log, "ab") as out:
        out.write(("$ " + " ".join(map(str, command)) + "\n").encode())
        out.flush()
        return subprocess.run(command, stdout=out, stderr=subprocess.STDOUT,
                              stdin=subprocess.DEVNULL, check=False, **more).returncode


def build_base(tree, base, targets, jobs, more):
    base.mkdir(parents=True, exist_ok=True)
    update_sources(tree, base)
    log = base.parent / "base.log"
    log.unlink(missing_ok=True)
    command = ["cmake", "-S", str(base), "-B", str(base), "-G", "Ninja", "-DCMAKE_BUILD_TYPE=Release",
               "-DCMAKE_CXX_FLAGS_RELEASE=-O1 -DNDEBUG", "-DL4D_CUDA=OFF", "-DL4D_BUILD_BENCH=OFF",
               *more]
    if shutil.which("ccache"):
        command += ["-DCMAKE_C_COMPILER_LAUNCHER=ccache", "-DCMAKE_CXX_COMPILER_LAUNCHER=ccache"]
    if run_logged(command, log) != 0:
        sys.exit(f"mutants: configuring failed, see {log}")
    relative_rules(base)
    if run_logged(["ninja", "-C", str(base), "-j", str(jobs), *targets], log) != 0:
        sys.exit(f"mutants: the tree does not build, see {log}")


# Threads start tests here, so that limits are set by a process of its own, not between fork and exec.
LIMITED = ["bash", "-c", 'ulimit -v "$0"; ulimit -c 0; exec "$@"', str(MOST_MEMORY >> 10)]


def run_test(test, folder, log, limit):
    """None if it passes, else why it does not."""
    environment = dict(os.environ, PYTHON=sys.executable, GTEST_COLOR="no", GTEST_BREAK_ON_FAILURE="0")
    at = log.stat().st_size if log.exists() else 0
    scratch = pathlib.Path(tempfile.mkdtemp(prefix="mutant-", dir=folder.parent))
    environment["TMPDIR"] = environment["TEST_TMPDIR"] = str(scratch)
    with open(log, "ab") as out:
        process = subprocess.Popen(LIMITED + command_of(test, folder), cwd=folder, env=environment,
                                   stdout=out, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL,
                                   start_new_session=True)
        try:
            status = process.wait(timeout=limit)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, 9)
            process.wait()
            return f"no end after {limit:.0f} s"
        finally:
            shutil.rmtree(scratch, ignore_errors=True)
    said = log.read_bytes()[at:].decode(errors="replace")
    if re.search(r"Running 0 tests", said):
        return "there is no such test"
    if status == 77:
        return "skipped"
    if status == 0:
        return None
    failed = re.search(r"^\[  FAILED  \] ([^\s,]+)", said, re.M)
    return failed[1] if failed else f"exit status {status}"


# ---- the run ---------------------------------------------------------------------------------------


class Results:
    """What is known, kept after each mutant."""

    def __init__(self, path, tree):
        self.path, self.tree, self.lock = path, tree, threading.Lock()
        self.known, self.seconds = {}, {}
        if path.exists():
            stored = json.loads(path.read_text())
            if stored.get("tree") == tree:
                self.known, self.seconds = stored["mutants"], stored["seconds"]

    @staticmethod
    def key(mutant):
        return hashlib.sha256(mutant.text.encode()).hexdigest()[:16]

    def get(self, mutant):
        entry = self.known.get(mutant.name)
        return entry if entry and entry["mutant"] == self.key(mutant) else None

    def save(self):
        text = json.dumps({"tree": self.tree, "seconds": self.seconds, "mutants": self.known}, indent=1)
        scratch = self.path.with_suffix(".new")
        scratch.write_text(text)
        scratch.replace(self.path)

    def put(self, mutant, state, why, seconds):
        with self.lock:
            self.known[mutant.name] = {"mutant": self.key(mutant), "state": state, "why": why,
                                       "seconds": round(seconds, 1)}
            self.save()

    def put_seconds(self, test, seconds):
        with self.lock:
            self.seconds[test] = seconds
            self.save()


def try_mutant(mutant, folder, work, seconds):
    """(state, why)"""
    log = work / "logs" / f"{mutant.name}.log"
    log.unlink(missing_ok=True)
    try:
        text = mutant.apply(folder)
        (folder / mutant.file).unlink()
        (folder / mutant.file).write_text(text, encoding="utf-8")
    except Bad as e:
        return NOT_APPLIED, str(e)
    if run_logged(["ninja", "-C", str(folder), "-j", "2", *mutant.targets()], log) != 0:
        return NOT_BUILT, f"see {log}"
    for test in mutant.tests:
        why = run_test(test, folder, log, GRACE + 10 * seconds[test])
        if why is not None:
            return KILLED, why
    return SURVIVED, ", ".join(mutant.tests)


def in_workers(work, base, jobs, items, action):
    """action(item, folder) for each item, `jobs` at a time, each in a copy of base of its own."""
    todo = queue.Queue()
    for item in items:
        todo.put(item)
    wanted, failures = index(base), []

    def worker(number):
        folder = work / f"worker-{number}"
        if folder.exists():
            restore(base, folder, wanted)
        else:
            shutil.copytree(base, folder, symlinks=True)
        while not failures:
            try:
                item = todo.get_nowait()
            except queue.Empty:
                return
            try:
                action(item, folder)
            except Exception as e:  # pylint: disable=broad-except
                failures.append(e)
            restore(base, folder, wanted)

    threads = [threading.Thread(target=worker, args=(k,)) for k in range(min(jobs, len(items)))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    if failures:
        raise failures[0]


def run(tree, listing, work, names, jobs, cmake=(), seconds=None):
    """seconds: no mutant begins later than that after the first; which ones do begin is left to chance."""
    work = work.resolve()
    (work / "logs").mkdir(parents=True, exist_ok=True)
    mutants = load(listing, names)
    results = Results(work / "results.json", fingerprint(tree))
    todo = [m for m in mutants if results.get(m) is None]
    print(f"{len(mutants)} mutants, {len(mutants) - len(todo)} known from before, {jobs} at a time",
          flush=True)
    if todo:
        start = time.monotonic()
        targets = sorted({t for m in mutants for t in m.targets()})
        base = work / "base"
        build_base(tree, base, targets, jobs, cmake)
        print(f"built {', '.join(targets)} in {time.monotonic() - start:.0f} s", flush=True)
        unsound = {}

        def sound(test, folder):
            log = work / "logs" / ("without-" + re.sub(r"\W+", "_", test)[:100] + ".log")
            log.unlink(missing_ok=True)
            begin = time.monotonic()
            why = run_test(test, folder, log, 600)
            if why is None:
                results.put_seconds(test, time.monotonic() - begin)
            else:
                unsound[test] = why

        wanted = sorted({t for m in todo for t in m.tests} - results.seconds.keys())
        in_workers(work, base, jobs, wanted, sound)
        done = [0]

        def one(mutant, folder):
            begin = time.monotonic()
            if begin > deadline:
                return
            bad = [f"{t}: {unsound[t]}" for t in mutant.tests if t in unsound]
            state, why = (NOT_SOUND, "; ".join(bad)) if bad else try_mutant(
                mutant, folder, work, results.seconds)
            seconds = time.monotonic() - begin
            if state in (KILLED, SURVIVED):
                results.put(mutant, state, why, seconds)
            else:
                with results.lock:
                    others[mutant.name] = {"state": state, "why": why, "seconds": seconds}
            done[0] += 1
            print(f"[{done[0]}/{len(todo)}] {mutant.name}: {state} ({why}), {seconds:.0f} s", flush=True)

        others = {}
        # What many objects depend on takes longest, so it goes first.
        todo.sort(key=lambda m: (not m.file.endswith(".h"), m.name))
        deadline = float("inf")
        if seconds is not None:
            random.shuffle(todo)
            deadline = time.monotonic() + seconds
        in_workers(work, base, jobs, todo, one)
    else:
        others = {}
    return report(mutants, results, others, seconds is None)


def report(mutants, results, others, whole):
    """whole: a mutant that did not run is a failure."""
    print(f"\n{'mutant':<34} {'result':<16} by")
    count, left = {}, []
    for mutant in mutants:
        entry = results.get(mutant) or others.get(mutant.name) or {"state": NOT_RUN, "why": ""}
        count[entry["state"]] = count.get(entry["state"], 0) + 1
        print(f"{mutant.name:<34} {entry['state']:<16} {entry['why']}")
        if entry["state"] != KILLED and (whole or entry["state"] != NOT_RUN):
            left.append((mutant, entry))
    for mutant, entry in left:
        print(f"\n{entry['state']}: {mutant.name}\n  {mutant.breaks}\n  {entry['why']}")
    print("\n" + ", ".join(f"{n} {state}" for state, n in sorted(count.items())))
    return 1 if left else 0


def main():
    parser = argparse.ArgumentParser(description="Mutation tests; see the top of this file.")
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--self-test", action="store_true")
    parser.add_argument("--list", action="store_true", help="names, and what each breaks")
    parser.add_argument("--least", type=int, default=60, help="of --check: how many there must be")
    parser.add_argument("--fresh", action="store_true", help="forget what is known")
    parser.add_argument("--tree", type=pathlib.Path, default=ROOT)
    parser.add_argument("--from", dest="listing", type=pathlib.Path, default=LIST, metavar="LIST")
    parser.add_argument("--work", type=pathlib.Path, default=None, help="default: TREE/build/mutants")
    parser.add_argument("--jobs", type=int, default=int(os.environ.get("L4D_JOBS") or os.cpu_count()))
    parser.add_argument("--seconds", type=float, help="begin no mutant later than that after the first, and "
                        "take them in a random order")
    parser.add_argument("--cmake", action="append", default=[], metavar="ARGUMENT",
                        help="given to cmake too: --cmake=-DCMAKE_PREFIX_PATH=/opt")
    parser.add_argument("names", nargs="*")
    a = parser.parse_args()
    try:
        if a.self_test:
            sys.path.insert(0, str(HERE))
            import self_test  # pylint: disable=import-outside-toplevel
            return self_test.main()
        if a.check:
            return check(a.listing, a.tree, a.least)
        if a.list:
            for mutant in load(a.listing, a.names):
                print(f"{mutant.name:<34} {mutant.breaks}")
            return 0
        work = a.work or a.tree / "build" / "mutants"
        if a.fresh:
            (work / "results.json").unlink(missing_ok=True)
        return run(a.tree.resolve(), a.listing, work, a.names, max(1, a.jobs), a.cmake, a.seconds)
    except Bad as e:
        print(f"mutants: {e}", file=sys.stderr)
        return 1


if __name__ == "__main__":
    sys.exit(main())

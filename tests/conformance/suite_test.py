#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The conformance suite itself, and its runner: suite_test.py [C_COMPILER]"""

import copy
import hashlib
import json
import pickle
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest
import xml.etree.ElementTree as ET
from pathlib import Path

sys.dont_write_bytecode = True
sys.path.insert(0, str(Path(__file__).resolve().parent))

import schema       # noqa: E402

CONFORMANCE = Path(__file__).resolve().parents[2] / "conformance"
SUITE = json.loads((CONFORMANCE / "suite.json").read_text(encoding="utf-8"))
SCHEMA = json.loads((CONFORMANCE / "suite.schema.json").read_text(encoding="utf-8"))
MOST_BYTES, MOST_OF_ONE, MOST_LARGE = 12 << 20, 100 << 10, 8
COMPILER = []


def run(*arguments, decoder):
    """Exit status and lines of run.py."""
    out = subprocess.run([sys.executable, "-B", str(CONFORMANCE / "run.py"), *arguments, "--", *decoder],
                         capture_output=True, text=True, check=False)
    return out.returncode, out.stdout.splitlines()


class Suite(unittest.TestCase):
    def test_it_is_what_its_schema_says(self):
        self.assertEqual(schema.violations(SUITE, SCHEMA), [])

    def test_the_schema_finds_what_is_wrong(self):
        for edit in (lambda s: s.pop("name"), lambda s: s["vectors"][0].update(sha256="x"),
                     lambda s: s["vectors"][0].update(more=1), lambda s: s["vectors"][0].update(profile=True),
                     lambda s: s["vectors"][0]["queries"][0]["digests"].pop("all"),
                     lambda s: s["vectors"][0]["queries"][0]["digests"].update(x="y"),
                     lambda s: s["vectors"][0].update(queries=[]), lambda s: s["vectors"][0].update(bytes=-1)):
            broken = copy.deepcopy({**SUITE, "vectors": SUITE["vectors"][:1]})
            edit(broken)
            self.assertEqual(len(schema.violations(broken, SCHEMA)), 1)

    def test_it_lists_the_files_that_are_there(self):
        there = {p.relative_to(CONFORMANCE).as_posix() for p in (CONFORMANCE / "vectors").rglob("*") if p.is_file()}
        self.assertEqual(there, {v["file"] for v in SUITE["vectors"]})
        self.assertEqual(len({v["name"] for v in SUITE["vectors"]}), len(SUITE["vectors"]))
        for vector in SUITE["vectors"]:
            data = (CONFORMANCE / vector["file"]).read_bytes()
            self.assertEqual((len(data), hashlib.sha256(data).hexdigest()), (vector["bytes"], vector["sha256"]))

    def test_it_is_small(self):
        sizes = [v["bytes"] for v in SUITE["vectors"]]
        self.assertLess(sum(sizes), MOST_BYTES)
        self.assertLess(sum(size > MOST_OF_ONE for size in sizes), MOST_LARGE)

    def test_groups_and_profiles_are_there(self):
        for group, least in (("core", 60), ("uncommon", 60), ("faulty", 150)):
            self.assertGreater(sum(v["group"] == group for v in SUITE["vectors"]), least, group)
        legal = [v for v in SUITE["vectors"] if v["group"] != "faulty"]
        self.assertEqual({v["profile"] for v in legal}, {0, 1, 2, 3})
        for feature in ("codebooks", "permanent", "rans", "raw", "rcq", "stages", "stored", "transform",
                        "two-parts", "zstd"):
            self.assertGreater(sum(feature in v["features"] for v in legal), 3, feature)


class Runner(unittest.TestCase):
    """Contracts that are broken, with decoders of one line of shell."""

    def outcome(self, script, *options, only="core/tiny"):
        status, lines = run("--only", only, "--quiet", *options, decoder=["sh", "-c", script, "decoder"])
        passed, _, failed, _ = lines[-1].split()
        self.assertEqual(status, 0 if failed == "0" and passed != "0" else 1)
        return lines

    def fails(self, script, why, *options, **more):
        lines = self.outcome(script, *options, **more)
        self.assertEqual(lines[-1].split()[0], "0", lines)
        self.assertIn(why, lines[0])

    def test_answers_that_break_the_contract(self):
        self.fails("exit 3", "exit status 3")
        self.fails("kill -9 $$", "ended by SIGKILL")
        self.fails("echo no", "not one JSON object")
        self.fails("echo '[]'", "not a JSON object")
        self.fails("echo '{}'", "all differs")
        self.fails("""echo '{"refused": "PAGE-1"}'""", "does not go with")
        self.fails("""echo '{"refused": "PAGE-1"}'; exit 1""", "breaks no rule")
        self.fails("""echo '{"num_gaussians": 3, "digests": {"all": "0"}}'""", "all differs")
        self.fails("sleep 9", "no answer after", "--timeout", "0.2")
        self.fails("""echo '{"num_gaussians": "x"}'""", "num_gaussians is")
        self.fails("""echo '{"digests": 5}'""", "digests is 5")
        self.fails("head -c 200000 /dev/zero | tr '\\0' '['", "not one JSON object")
        self.fails("head -c 9000000 /dev/zero", "longer than")

    def test_refusals(self):
        accepts = """echo '{"num_gaussians": 0, "digests": {"all": "0"}}'"""
        refuses = """echo '{"refused": "%s"}'; exit 1"""
        self.fails(accepts, "accepted; it breaks PAGE-1", only="faulty/PAGE-1")
        self.fails(refuses % "VQ-1", "refused for VQ-1", only="faulty/PAGE-1")
        for named in ("PAGE-1", "rule"):
            self.assertIn(" 0 failed", self.outcome(refuses % named, only="faulty/PAGE-1")[-1])

    def test_what_is_not_there_is_skipped(self):
        lines = self.outcome("""echo '{"unavailable": "all"}'""")
        self.assertEqual(lines[-1], "0 passed, 0 failed")
        self.assertIn("the claim does not hold", lines[-2])
        self.assertIn("skipped", lines[-3])

    def wait_for(self, what, holds):
        """Long enough for a machine that has much else to do."""
        end = time.monotonic() + 120
        while not holds():
            if time.monotonic() > end:
                self.fail(f"still not after 120 s: {what}")
            time.sleep(0.05)

    def test_what_a_decoder_leaves_behind_ends_with_it(self):
        with tempfile.TemporaryDirectory() as folder:
            note = Path(folder) / "pid"
            # On a busy machine a shell may be ended before it has noted its child: then it gets more time.
            for end, limits in (("sleep 1000", (0.5, 5, 50)), ("exit 3", (300,))):
                note.write_text("")
                for limit in limits:
                    if not note.read_text():
                        self.outcome(f"sleep 1000 & echo $! > {note}; {end}", "--timeout", str(limit), "-j", "1",
                                     only="FILE-1-short")
                self.assertTrue(note.read_text(), "the shell notes no child")
                state = Path(f"/proc/{int(note.read_text())}/stat")
                self.wait_for(f"the end of a child, {end}", lambda: self.is_over(state))

    @staticmethod
    def is_over(state):
        try:
            return state.read_text().split()[2] == "Z"
        except OSError:
            return True

    def test_an_interrupted_run_reports_what_it_knows(self):
        with tempfile.TemporaryDirectory() as folder:
            script = f"""if [ -e {folder}/one ]; then touch {folder}/two; sleep 1000; fi; touch {folder}/one; exit 3"""
            # Commands in the background of a script ignore SIGINT, and so would their children.
            signal.signal(signal.SIGINT, signal.default_int_handler)
            process = subprocess.Popen(
                [sys.executable, "-B", str(CONFORMANCE / "run.py"), "--quiet", "-j", "1", "--json", f"{folder}/j",
                 "--", "sh", "-c", script], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
            self.addCleanup(process.kill)
            self.wait_for("the second query", (Path(folder) / "two").exists)
            process.send_signal(signal.SIGINT)
            out, err = process.communicate(timeout=300)
            self.assertEqual(process.returncode, 130, err)
            self.assertNotIn("Traceback", err)
            self.assertIn("0 passed, 1 failed", out)
            self.assertIn("queries were not run", out)
            self.assertEqual(json.loads(Path(f"{folder}/j").read_text(encoding="utf-8"))["failed"], 1)

    def test_what_is_of_no_use_is_refused_before_anything_runs(self):
        for options, decoder, why in (
                (["--level", "-1"], ["true"], "--level"), (["--level", "99"], ["true"], "--level"),
                (["--timeout", "nan"], ["true"], "--timeout"), (["--timeout", "0"], ["true"], "--timeout"),
                (["-j", "0"], ["true"], "-j"), (["--group", "nosuch"], ["true"], "core"),
                (["--only", "core/*"], ["true"], "no pattern"), (["--suite", "/nosuch"], ["true"], "/nosuch"),
                (["--suite", __file__], ["true"], "no suite"), (["--json", "/nosuch/x"], ["true"], "/nosuch/x"),
                (["--junit", "/tmp"], ["true"], "/tmp"), (["--adapter", "/nosuch.py"], ["true"], "/nosuch.py"),
                ([], ["/nosuch"], "/nosuch"), ([], [], "after --")):
            done = subprocess.run([sys.executable, "-B", str(CONFORMANCE / "run.py"), *options, "--", *decoder],
                                  capture_output=True, text=True, check=False)
            self.assertEqual(done.returncode, 2, options)
            self.assertNotIn("Traceback", done.stderr)
            self.assertIn(why, done.stderr.splitlines()[-1])

    def test_files_that_are_not_those_of_the_suite_are_named(self):
        with tempfile.TemporaryDirectory() as folder:
            copy_of = Path(folder)
            (copy_of / "suite.json").write_text((CONFORMANCE / "suite.json").read_text(encoding="utf-8"))
            shutil.copytree(CONFORMANCE / "vectors" / "core", copy_of / "vectors" / "core")
            tiny = copy_of / "vectors" / "core" / "tiny.l4d"
            tiny.write_bytes(tiny.read_bytes().replace(b"\n", b"\r\n"))
            for only in ("core/tiny", "FILE-1-short"):
                done = subprocess.run([sys.executable, "-B", str(CONFORMANCE / "run.py"), "--suite",
                                       str(copy_of / "suite.json"), "--only", only, "--", "true"],
                                      capture_output=True, text=True, check=False)
                self.assertEqual(done.returncode, 2)
                self.assertIn("not those of the suite", done.stderr)

    def test_claims(self):
        names = lambda *o: {r["vector"] for r in self.results(*o)}
        everything = names()
        self.assertEqual(everything, {v["name"] for v in SUITE["vectors"]})
        indexed, main = names("--profile", "indexed"), names("--profile", "main")
        self.assertTrue(indexed < main < everything)
        self.assertIn("core/lossless", names("--profile", "lossless") - main)
        self.assertTrue(names("--level", "1") < everything)
        self.assertFalse(any("--packed" in r["arguments"] for r in self.results("--without", "packed")))

    def results(self, *options):
        with tempfile.TemporaryDirectory() as folder:
            run(*options, "--json", f"{folder}/j", "--junit", f"{folder}/x", "--quiet", decoder=["false"])
            document = json.loads(Path(f"{folder}/j").read_text(encoding="utf-8"))
            root = ET.parse(f"{folder}/x").getroot()
        self.assertEqual(len(root), len(document["results"]))
        self.assertEqual(len(root.findall("testcase/failure")), document["failed"])
        return document["results"]


class Batch(unittest.TestCase):
    """A decoder that answers many questions in one process."""

    def answers(self, program, *options):
        with tempfile.TemporaryDirectory() as folder:
            run("--only", "core/tiny", "-j", "1", "--quiet", "--json", f"{folder}/j", *options, "--adapter",
                str(CONFORMANCE / "adapters" / "batch.py"), decoder=[sys.executable, "-c", program])
            return json.loads(Path(f"{folder}/j").read_text(encoding="utf-8"))["results"]

    def test_a_decoder_that_ends_is_started_again(self):
        found = self.answers("import sys\nsys.stdin.readline()\nprint('0\\t{\"num_gaussians\": 7}', flush=True)\n"
                             "sys.stdin.readline()\nsys.exit(5)")
        self.assertEqual([r["why"].split(":")[0].split(";")[0] for r in found[:3]],
                         ["num_gaussians is 7, not 3", "exit status 5", "num_gaussians is 7, not 3"])

    def test_a_decoder_that_says_nothing_is_ended(self):
        found = self.answers("import time\ntime.sleep(60)", "--timeout", "0.3")
        self.assertTrue(found and all(r["why"] == "no answer after 0.3 s" for r in found))

    def test_broken_rules_cross_from_one_process_to_another(self):
        sys.path.insert(0, str(CONFORMANCE / "reference"))
        from arithmetic import Invalid
        again = pickle.loads(pickle.dumps(Invalid("PAGE-1", "a word", 17)))
        self.assertEqual((str(again), again.clause, again.offset), ("PAGE-1: a word", "PAGE-1", 17))


class Fluster(unittest.TestCase):
    def test_it_lists_every_legal_stream(self):
        out = subprocess.run([sys.executable, "-B", str(CONFORMANCE / "fluster.py"), "--source", "https://x.org/l4d"],
                             capture_output=True, text=True, check=True).stdout
        vectors = json.loads(out)["test_vectors"]
        legal = [v for v in SUITE["vectors"] if v["group"] in ("core", "uncommon")]
        self.assertEqual([v["name"] for v in vectors], [v["name"].replace("/", "-") for v in legal])
        for vector, of in zip(vectors, legal):
            self.assertEqual(vector["source"], "https://x.org/l4d/" + of["file"])
            data = (CONFORMANCE / of["file"]).read_bytes()
            self.assertEqual(vector["source_checksum"], hashlib.md5(data).hexdigest())
            self.assertEqual(vector["result"], of["queries"][0]["digests"]["all"])


class Example(unittest.TestCase):
    def test_the_decoder_in_c_stands_where_the_page_says(self):
        if not COMPILER:
            self.skipTest("no C compiler given")
        with tempfile.TemporaryDirectory() as folder:
            program = f"{folder}/magic"
            subprocess.run([COMPILER[0], "-std=c99", "-Wall", "-Werror", "-o", program,
                            str(CONFORMANCE / "examples" / "magic.c")], check=True)
            without = [w for f in ("packed", "validate", "demand") for w in ("--without", f)]
            status, lines = run(*without, decoder=[program])
        self.assertEqual(status, 1)
        rows = {words[0]: words[1:] for words in map(str.split, lines) if words}
        for clause in ("FILE-1", "FILE-2", "FILE-3"):
            self.assertNotIn("<--", rows[clause], clause)
        for clause in ("FILE-4", "PAGE-1", "DEC-1"):
            self.assertIn("<--", rows[clause], clause)


if __name__ == "__main__":
    COMPILER += sys.argv[1:]
    unittest.main(argv=sys.argv[:1])

#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The conformance suite itself, and its runner: suite_test.py [C_COMPILER]"""

import copy
import hashlib
import json
import subprocess
import sys
import tempfile
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
        self.assertEqual(status, 0 if lines[-1].endswith(" 0 failed") else 1)
        return lines

    def fails(self, script, why, *options, **more):
        lines = self.outcome(script, *options, **more)
        self.assertEqual(lines[-1].split()[0], "0", lines)
        self.assertIn(why, lines[0])

    def test_answers_that_break_the_contract(self):
        self.fails("exit 3", "exit status 3")
        self.fails("kill -9 $$", "exit status -9")
        self.fails("echo no", "not one JSON object")
        self.fails("echo '[]'", "not a JSON object")
        self.fails("echo '{}'", "all differs")
        self.fails("""echo '{"refused": "PAGE-1"}'""", "does not go with")
        self.fails("""echo '{"refused": "PAGE-1"}'; exit 1""", "breaks no rule")
        self.fails("""echo '{"num_gaussians": 3, "digests": {"all": "0"}}'""", "all differs")
        self.fails("sleep 9", "no answer after", "--timeout", "0.2")

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
        self.assertIn("skipped", lines[-2])

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
            run(*options, "--json", f"{folder}/j", "--junit", f"{folder}/x", "--quiet", decoder=["/nowhere"])
            document = json.loads(Path(f"{folder}/j").read_text(encoding="utf-8"))
            root = ET.parse(f"{folder}/x").getroot()
        self.assertEqual(len(root), len(document["results"]))
        self.assertEqual(len(root.findall("testcase/failure")), document["failed"])
        return document["results"]


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

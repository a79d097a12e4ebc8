#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Each wrong decoder of conformance/wrong is caught by the vector that is meant to catch it, and the decoder
without a mistake is not."""

import json
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

CONFORMANCE = Path(__file__).resolve().parents[2] / "conformance"
DECODER = [sys.executable, "-B", str(CONFORMANCE / "wrong" / "decoder.py")]
LEAST = 12


def mistakes():
    """(name, vector)"""
    lines = subprocess.run([*DECODER, "--list"], capture_output=True, text=True, check=True).stdout
    return [line.split()[:2] for line in lines.splitlines()]


def failures(name, vectors):
    """Vectors that fail with a mistake."""
    only = [w for v in vectors for w in ("--only", v)]
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([sys.executable, "-B", str(CONFORMANCE / "run.py"), *only, "--quiet", "--json",
                        f"{folder}/json", "--", *DECODER, name], capture_output=True, check=False)
        document = json.loads(Path(f"{folder}/json").read_text(encoding="utf-8"))
    return {r["vector"] for r in document["results"] if r["outcome"] == "failed"}, document["passed"]


class Wrong(unittest.TestCase):
    def test_every_mistake_is_caught(self):
        listed = mistakes()
        self.assertGreaterEqual(len(listed), LEAST)
        for name, vector in listed:
            with self.subTest(name):
                self.assertIn(vector, failures(name, [vector])[0])

    def test_without_a_mistake_nothing_fails(self):
        failed, passed = failures("none", sorted({vector for _, vector in mistakes()}))
        self.assertEqual(failed, set())
        self.assertGreater(passed, LEAST)


if __name__ == "__main__":
    unittest.main()

#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Streams at each limit of conformance levels and just beyond it, by the library and by a simulated channel:
limits_test.py L4DCODEC LEVEL.."""

import json
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

CONFORMANCE = Path(__file__).resolve().parents[2] / "conformance"
PYTHON = [sys.executable, "-B"]
TOOL, LEVELS = [], []


def run(*arguments):
    return subprocess.run([*PYTHON, *map(str, arguments)], capture_output=True, text=True, check=False)


def rate(path, *options):
    """Exit status and answer of rate.py."""
    done = run(CONFORMANCE / "rate.py", "--json", *options, path)
    return done.returncode, json.loads(done.stdout) if done.stdout else None


class Limits(unittest.TestCase):
    def test_all_limits_hold_to_the_byte(self):
        for level in LEVELS:
            with self.subTest(level=level), tempfile.TemporaryDirectory() as folder:
                self.hold(int(level), Path(folder))

    def hold(self, level, folder):
        made = run(CONFORMANCE / "generate.py", "--limits", level, folder)
        self.assertEqual(made.returncode, 0, made.stderr)
        done = run(CONFORMANCE / "run.py", "--suite", folder / "suite.json", "--quiet", "--adapter",
                   CONFORMANCE / "adapters" / "l4dcodec.py", "--", *TOOL)
        queries = 40 if level == 1 else 32          # level 1 has two limits of undeclared lossless streams
        self.assertEqual(done.stdout.splitlines()[-1], f"{queries} passed, 0 failed", done.stdout)
        for name in ("start", "burst"):
            at, beyond = (folder / "vectors" / "limits" / f"level-{level}-{name}-{w}.l4d" for w in ("at", "beyond"))
            status, out = rate(at)
            self.assertEqual((status, out["waits"], out["level_holds"], out["level"]), (0, [], True, level), name)
            status, out = rate(beyond)
            self.assertEqual((status, out["level_holds"]), (1, False), name)
            if name == "burst":             # of the one byte that is missing
                self.assertEqual([w["seconds"] * out["bytes_per_second"] for w in out["waits"]], [1.0])


class Channel(unittest.TestCase):
    STREAM = CONFORMANCE / "vectors" / "core" / "encoder-moving-default.l4d"

    def test_the_least_delay_is_the_least(self):
        options = ["--bytes-per-second", "5000"]
        _, out = rate(self.STREAM, *options, "--delay", "9")
        self.assertEqual(out["waits"], [])
        self.assertGreater(out["later_bytes"], 0)
        self.assertEqual(rate(self.STREAM, *options, "--delay", out["least_delay"] + 1e-9)[0], 0)
        status, late = rate(self.STREAM, *options, "--delay", out["least_delay"] - 1e-3)
        self.assertEqual(status, 1)
        self.assertAlmostEqual(sum(w["seconds"] for w in late["waits"]), 1e-3, places=9)

    def test_a_slow_channel_and_a_small_buffer_make_it_wait(self):
        _, out = rate(self.STREAM, "--bytes-per-second", "100", "--delay", "0")
        self.assertEqual(out["waits"][0]["at"], 0)
        total = (out["start_bytes"] + out["later_bytes"]) / 100
        self.assertGreater(total, sum(w["seconds"] for w in out["waits"]))
        self.assertEqual(rate(self.STREAM, "--bytes-per-second", "1000", "--delay", "60", "--buffer", "0")[0], 1)

    def test_what_it_refuses(self):
        tiny = CONFORMANCE / "vectors" / "core" / "tiny.l4d"
        self.assertEqual(rate(tiny), (2, None))
        self.assertEqual(rate(tiny, "--bytes-per-second", "0", "--delay", "1"), (2, None))
        self.assertEqual(rate("/nowhere"), (2, None))
        self.assertEqual(rate(CONFORMANCE / "vectors" / "faulty" / "FILE-4.l4d"), (3, None))


if __name__ == "__main__":
    TOOL.append(sys.argv[1])
    LEVELS += sys.argv[2:]
    unittest.main(argv=sys.argv[:1])

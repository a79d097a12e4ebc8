#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Section 20 of spec/l4d.md with random files of several streams, right ones and wrong ones: the library and
conformance/reference find the same members and the same broken rules. members_test.py TOOL DUMP_VALUES"""

import json
import random
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

sys.dont_write_bytecode = True

import generator_path           # noqa: F401, its import makes the following ones possible
import member_files as mf
from arithmetic import Invalid
from decoder import Decoder
from members import INDEX, MEDIA, STANDING, check_index, members
from validate import validate_file

VECTORS = Path(__file__).resolve().parents[2] / "conformance" / "vectors"
NUM_FILES = 300
UNKNOWN = 7                         # a role of a later version
PROGRAMS = {}


def random_stream(rng, number, time, standing):
    """A member that follows others, mostly as the rules have it. Returns its bytes and the end of its span."""
    role = rng.choice([STANDING] * 9 + [MEDIA] * 20 + [UNKNOWN])
    needs = sorted(rng.sample(standing, rng.randint(0, len(standing)))) if role == MEDIA else []
    slip = rng.random()
    if slip < 0.03:
        needs = [*needs, rng.randrange(number + 2)]
    if slip > 0.97:
        time -= rng.choice([0.125, 2.0 ** -40])
    extensions = [mf.member(number, role, needs, time - mf.BEGIN,
                            critical=None if rng.random() < 0.97 else not needs)]
    begin, end = mf.BEGIN, mf.BEGIN + mf.LENGTH
    if rng.random() < 0.4:
        begin, end = sorted(rng.sample([1.0, 1.0625, 1.2, 1.375, 1.5], 2))
        extensions.append(mf.edit(begin, end))
    if rng.random() < 0.02:
        extensions.append(extensions[-1])
    rng.shuffle(extensions)
    shift = time - mf.BEGIN
    return role, mf.stream(*extensions, only=rng.randrange(2)), end + shift


def random_file(rng):
    data, number, time, standing = b"", rng.choice([0, 0, 5]), rng.choice([1.0, 0.3, -7.7]), []
    for _ in range(rng.randint(1, 5)):
        role, stream, end = random_stream(rng, number, time, standing)
        if role == STANDING:
            standing.append(number)
        elif role == MEDIA:
            time = end
        number += rng.choice([1, 1, 3, 0] if rng.random() < 0.1 else [1, 1, 3])
        data += stream
    if rng.random() < 0.4:
        try:
            data = mf.index(data, number)
        except Invalid:
            pass                          # nothing lists what is broken
    if rng.random() < 0.15:
        data = mf.signed(data)
    if rng.random() < 0.15:
        data = data[:rng.randrange(41, len(data))]
    elif rng.random() < 0.15:
        at = rng.randrange(len(data))
        data = data[:at] + bytes([data[at] ^ 1 << rng.randrange(8)]) + data[at + 1:]
    return data


def verdict(data):
    """The clause that the reference decoder names, or None."""
    try:
        validate_file(data)
    except Invalid as broken:
        return broken.clause
    return None


def listed(data):
    """Members up to the first that is not whole or breaks a rule."""
    out = []
    try:
        for m in members(data):
            out.append([m.own["number"], m.own["role"], m.offset, len(m.data), *m.span, m.needs])
    except Invalid:
        pass
    return out


class Members(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.files = [random_file(random.Random(seed)) for seed in range(NUM_FILES)]
        cls.verdicts = [verdict(data) for data in cls.files]

    def test_the_files_are_right_and_wrong(self):
        self.assertGreater(sum(v is None for v in self.verdicts), NUM_FILES // 4)
        self.assertGreater(len(set(self.verdicts)), 8)

    # spec: MEMB-1, MEMB-5, MEMB-6, MEMB-7, MEMB-8, MEMB-9, HEAD-21
    def test_both_readers_find_the_same_broken_rule(self):
        with tempfile.TemporaryDirectory() as folder:
            paths = [Path(folder) / f"{i}.l4d" for i in range(NUM_FILES)]
            for path, data in zip(paths, self.files):
                path.write_bytes(data)
            out = subprocess.run([PROGRAMS["dump_values"], "validate", *paths], capture_output=True, text=True,
                                 check=True).stdout
        found = [part.split("\n")[1:-1] for part in out.split("file " + folder)[1:]]
        for seed, (want, lines) in enumerate(zip(self.verdicts, found)):
            with self.subTest(f"seed {seed}"):
                if want is None:
                    self.assertEqual(lines, [])
                else:
                    self.assertIn("violation " + want, lines)

    # spec: MEMB-4, MEMB-6, MEMB-10
    def test_both_readers_list_the_same_members(self):
        roles = {"media": MEDIA, "standing": STANDING, "index": INDEX, "unknown": UNKNOWN}
        for seed in range(0, NUM_FILES, 4):
            # An index has a span by its form alone, and the tool gives it none.
            want = [m[:4] + [None, None] + m[6:] if m[1] == INDEX else m for m in listed(self.files[seed])]
            with self.subTest(f"seed {seed}"), tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / "file.l4d"
                path.write_bytes(self.files[seed])
                if not want:
                    continue
                out = subprocess.run([PROGRAMS["tool"], "manifest", path, "-o", path.with_suffix(".m3u8"), "--json"],
                                     capture_output=True, text=True, check=False)
                document = json.loads(out.stdout)
                if "error" in document:
                    self.assertNotIn(MEDIA, [m[1] for m in want], document)
                    continue
                got = [[m["number"], roles[m["role"]], m["offset"], m["bytes"], m["begin"], m["end"], m["needs"]]
                       for m in document["members"]]
                # A list of an index knows nothing of damage inside of members.
                self.assertEqual(got[:len(want)], want)
                if self.verdicts[seed] is None:
                    self.assertEqual(len(got), len(want))

    def test_an_index_of_each_kind_was_drawn(self):
        with_index = 0
        for data, clause in zip(self.files, self.verdicts):
            if clause is None:
                found = list(members(data))
                check_index(found)
                with_index += found[-1].own["role"] == INDEX
        self.assertGreater(with_index, NUM_FILES // 20)


class Copies(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.source, self.copy = Path(folder.name) / "source.l4d", Path(folder.name) / "copy.l4d"

    def tool(self, *arguments):
        out = subprocess.run([PROGRAMS["tool"], *arguments, "--json"], capture_output=True, text=True, check=False)
        return out.returncode, json.loads(out.stdout)

    def remux(self, data):
        self.source.write_bytes(data)
        return self.tool("remux", "-f", self.source, "-o", self.copy)[0]

    def test_of_vectors_decode_to_the_same_bits(self):
        copied = 0
        for path in sorted(p for group in ("core", "uncommon") for p in (VECTORS / group).glob("*.l4d"))[::4]:
            data = path.read_bytes()
            with self.subTest(path.name):
                later_version = data[9] > 0
                self.assertEqual(self.remux(data), 5 if later_version else 0)
                if later_version:
                    continue
                validate_file(self.copy.read_bytes())
                self.assertEqual(self.tool("validate", self.copy)[0], 0)
                digests = [self.tool("decode", "--digest", p)[1]["digests"] for p in (self.source, self.copy)]
                self.assertEqual(*[d["all"] for d in digests])
                copied += 1
        self.assertGreater(copied, 20)

    def test_keep_extensions_that_nobody_knows(self):
        unknown = [{"id": 70000, "critical": False}, {"id": 70001, "critical": False, "raw": b"of another"}]
        self.assertEqual(self.remux(mf.stream(*unknown, mf.edit(1.0, 1.25))), 0)
        validate_file(self.copy.read_bytes())
        file = Decoder(self.copy.read_bytes())
        found = {e["id"]: e for e in file.header["extensions"]}
        self.assertEqual(set(found), {mf.EDIT, 70000, 70001})
        self.assertEqual(file.file.chunk(found[70001]["chunk"], 100).raw, b"of another")


if __name__ == "__main__":
    PROGRAMS.update(tool=sys.argv[1], dump_values=sys.argv[2])
    unittest.main(argv=sys.argv[:1])

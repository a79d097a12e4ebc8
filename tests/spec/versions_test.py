#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Section 19 of spec/l4d.md with streams of versions that do not exist yet, for the library and for
conformance/reference: versions_test.py TOOL ENCODE_SCENE"""

import json
import re
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

sys.dont_write_bytecode = True

import generator_path           # its import makes the following ones possible
import random_stream
import later_version
import stream_builder as sb
import digests
from decoder import Decoder, Query
from validate import validate

EXAMPLES = sb.ROOT / "spec" / "examples"
REFERENCE = sb.ROOT / "conformance" / "reference" / "l4d.py"
NUM_RANDOM_STREAMS = 15
PROGRAMS = {}


class Files:
    """A temporary folder, and the programs on what lies there."""

    def __init__(self, folder):
        self.folder = Path(folder)

    def write(self, data):
        (self.folder / "stream.l4d").write_bytes(data)

    def tool(self, verb, *arguments):
        """(exit status, document)"""
        out = subprocess.run([PROGRAMS["tool"], verb, "stream.l4d", "--json", *arguments],
                             cwd=self.folder, capture_output=True, text=True, check=False)
        return out.returncode, json.loads(out.stdout)

    def reference(self, *arguments):
        out = subprocess.run([sys.executable, "-B", REFERENCE, *arguments, "stream.l4d"],
                             cwd=self.folder, capture_output=True, text=True, check=False)
        return out.returncode, json.loads(out.stdout)

    def digests(self, *arguments):
        status, document = self.tool("decode", "--digest", *arguments)
        if status != 0:
            raise AssertionError(document)
        found = document["digests"]
        return {**{a["name"]: a["digest"] for a in found["arrays"]}, "all": found["all"]}


class Versions(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.files = Files(folder.name)

    @classmethod
    def setUpClass(cls):
        cls.streams = {p.name: p.read_bytes() for p in sorted(EXAMPLES.glob("*.l4d"))}
        with tempfile.TemporaryDirectory() as folder:
            for preset in ("default", "indexed", "lossless"):
                path = Path(folder) / "scene.l4d"
                subprocess.run([PROGRAMS["encode_scene"], preset, path], check=True)
                cls.streams[preset] = path.read_bytes()

    # spec: VER-1, VER-2, HEAD-8, FILE-3
    def test_a_later_minor_version_plays_as_before(self):
        for name, data in self.streams.items():
            later = later_version.next_minor(data)
            header = Decoder(later).header
            t = header["time_begin"] + 0.4 * Decoder(later).duration
            for arguments, query in (([], Query()), (["--time", repr(t)], Query(t, t)),
                                     (["--detail", "base"], Query(base_only=True))):
                with self.subTest(f"{name} {arguments}"):
                    self.files.write(data)
                    want = self.files.digests(*arguments)
                    self.files.write(later)
                    self.assertEqual(self.files.digests(*arguments), want)
                    self.assertEqual(digests.of_attributes(Decoder(later), query), want)

    # spec: VER-1, VER-2
    def test_it_is_valid_and_says_its_version(self):
        for name, data in self.streams.items():
            with self.subTest(name):
                later = later_version.next_minor(data, minor=255)
                validate(Decoder(later))
                self.files.write(later)
                status, document = self.files.tool("validate")
                self.assertEqual((status, document["errors"]), (0, []))
                self.assertEqual(self.files.tool("info")[1]["format_version"], "1.255")

    # spec: VER-1, VER-2
    def test_random_streams_play_too(self):
        for seed in range(NUM_RANDOM_STREAMS):
            data = random_stream.RandomScene(seed).build()
            self.files.write(later_version.next_minor(data))
            want = digests.of_attributes(Decoder(data), Query())
            self.assertEqual(self.files.digests(), want, seed)
            self.assertEqual(self.files.reference()[1]["digests"], want, seed)

    def test_the_simulation_adds_what_it_says(self):
        data = self.streams["default"]
        later = later_version.next_minor(data)
        table = sb.table("Header", Decoder(data).header)
        self.assertGreater(later_version.add_unknown_fields(table), 10)
        self.assertEqual(later[8:10], bytes((1, 1)))
        self.assertEqual(later[10] & 0xFE, 0xFA)
        header = Decoder(later).header
        self.assertEqual([e["id"] for e in header["extensions"]], [later_version.EXPERIMENTAL + 1])
        self.assertEqual(header["layers"][0]["scale"]["basis"]["codebook"]["reserved"], 0xFF)
        self.assertEqual(later.count(b"\x03\0\0\x001.1\0") > 20, True)

    def refused(self, clause, name, code, message, of_validate=None):
        """By every verb that reads, and by the reference decoder. code: the exit status; of validate,
        for which a broken rule is an answer, another one where the stream is damaged."""
        for verb, *arguments in (("decode", "-o", "out.ply"), ("decode", "--digest"), ("info",),
                                 ("slice", "--time", "0", "-o", "out.ply"),
                                 ("render", "-o", "out.png")):
            status, document = self.files.tool(verb, *arguments)
            self.assertEqual((status, document["error"]["name"]), (code, name), verb)
            self.assertIn(f"spec {clause} at byte ", document["error"]["message"], verb)
            self.assertIn(message, document["error"]["message"], verb)
        status, document = self.files.tool("validate")
        self.assertEqual((status, [v["clause"] for v in document["errors"]]),
                         (of_validate or code, [clause]))
        self.assertIn(message, document["errors"][0]["message"])
        for query in ("all", "validate", "header"):
            status, document = self.files.reference("--query", query)
            self.assertEqual((status, document["refused"]), (1, clause))

    # spec: FILE-2, DEC-5
    def test_another_major_version_is_refused(self):
        data = self.streams["default"]
        for version in ((2, 0), (2, 1), (0, 9), (255, 255)):
            for of in (data, later_version.next_minor(data)):
                self.files.write(later_version.next_major(of, version))
                self.refused("FILE-2", "L4D_ERR_VERSION_UNSUPPORTED", 5,
                             f"bitstream version {version[0]}.{version[1]}; this library reads version 1")

    # spec: FILE-2
    def test_the_version_comes_before_all_that_it_may_change(self):
        """A scene header that is no FlatBuffer, and reserved flags, are of the other version."""
        for flags, place, size in ((1, 40, 10), (0xFF01, 40, 10), (1, 1 << 60, 1 << 31)):
            data = bytearray(self.streams["tiny.l4d"])
            data[40:50] = b"not known."
            later_version.file_header(data, (2, 0), flags, size, place, 0)
            self.files.write(bytes(data))
            self.refused("FILE-2", "L4D_ERR_VERSION_UNSUPPORTED", 5, "bitstream version 2.0")

    # spec: FILE-4
    def test_a_damaged_version_is_damage(self):
        data = bytearray(self.streams["tiny.l4d"])
        data[8] = 2
        self.files.write(bytes(data))
        self.refused("FILE-4", "L4D_ERR_CHECKSUM", 4, "", of_validate=1)

    # spec: HEAD-8
    def test_a_critical_extension_is_refused(self):
        self.files.write(later_version.next_minor(self.streams["tiny.l4d"], critical=True))
        self.refused("HEAD-8", "L4D_ERR_FEATURE_UNSUPPORTED", 5,
                     f"{later_version.EXPERIMENTAL + 1}")

    # spec: DIR-2
    def test_drafts_with_other_records_are_refused(self):
        """The worked example as the first draft had it."""
        data = (Path(__file__).resolve().parent / "drafts" / "first.l4d").read_bytes()
        self.files.write(data)
        status, document = self.files.tool("validate")
        self.assertEqual((status, [v["clause"] for v in document["errors"]]), (1, ["DIR-2"]))
        self.assertEqual(self.files.tool("decode", "--digest")[1]["error"]["name"], "L4D_ERR_CORRUPT")
        self.assertEqual(self.files.reference()[1]["refused"], "DIR-2")

    def test_the_appendix_on_drafts_names_what_exists(self):
        text = (sb.ROOT / "spec" / "l4d.md").read_text(encoding="utf-8")
        table = text.split("## Appendix D.")[1].split("\n## ")[0]
        size = sb.SCHEMA.size_align("PageRecord")[0]
        self.assertIn(f"A `PageRecord` has {size} bytes. Element", table)
        fields = {f.name for of in sb.SCHEMA.fields.values() for f in of}
        named = set(re.findall(r"`([a-z_]+)`", table)) - {"vq", "sq"}
        self.assertGreater(len(named), 15)
        self.assertEqual(named - fields, set())
        new = {f.name: size for f in sb.SCHEMA.fields["PageRecord"]
               for size in [sb.SCHEMA.size_align(f.type)[0]] if f.name.startswith("sh_")}
        self.assertEqual(size - sum(new.values()) + 4, 56)      # and 4 less of padding
        for clause in set(re.findall(r"[A-Z]{3,4}-\d+", table)) - {"UTF-8"}:
            self.assertTrue(f"- **{clause}**" in text, clause)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    PROGRAMS["tool"], PROGRAMS["encode_scene"] = sys.argv[1:]
    unittest.main(argv=sys.argv[:1])

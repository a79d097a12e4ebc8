#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Appendix J of spec/l4d.md and the files of spec/media: media_type_test.py

Exit status 77: a program that reads these files is missing, and all that could be checked is right."""

import json
import re
import shutil
import subprocess
import sys
import tempfile
import unittest
import xml.etree.ElementTree
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SPEC = (ROOT / "spec" / "l4d.md").read_text(encoding="utf-8")
TEXT = " ".join(SPEC.split("## Appendix J.")[1].split("\n## ")[0].split())
MAGIC, XML = (ROOT / "spec" / "media" / name for name in ("l4d.magic", "l4dcodec.xml"))
TYPE, EXTENSION = "model/l4d", "l4d"
STREAMS = sorted((ROOT / "spec" / "examples").glob("*.l4d"))


def wants(program):
    return unittest.skipUnless(shutil.which(program), f"{program} is not installed")


def run(*arguments, **options):
    return subprocess.run(arguments, capture_output=True, text=True, check=True, **options).stdout


class Text(unittest.TestCase):
    def test_template(self):
        """The items of RFC 6838, section 5.6, in their order."""
        items = re.findall(r"- \*\*([^*]+)\*\*:", TEXT)
        self.assertEqual(items, [
            "Type name", "Subtype name", "Required parameters", "Optional parameters",
            "Encoding considerations", "Security considerations", "Interoperability considerations",
            "Published specification", "Applications that use this media type",
            "Fragment identifier considerations", "Additional information",
            "Person and email address to contact for further information", "Intended usage",
            "Restrictions on usage", "Author", "Change controller"])
        kind, subtype = TYPE.split("/")
        self.assertIn(f"**Type name**: {kind} - **Subtype name**: {subtype} -", TEXT)
        self.assertIn(f"file name extension `.{EXTENSION}`, media type `{TYPE}`", " ".join(SPEC.split()))
        self.assertIn(f"File extension(s): `.{EXTENSION}`", TEXT)

    def test_parameters_are_those_of_the_registries(self):
        def entries(name):
            registry = json.loads((ROOT / "spec" / "registry" / f"{name}.json").read_text("utf-8"))
            return [e for e in registry["entries"] if e["id"] != 0]
        names = [f"`{e['name']}`" for e in entries("profile")]
        self.assertIn(f": {', '.join(names[:-1])} or {names[-1]}.", TEXT)
        levels = [e["id"] for e in entries("conformance-level")]
        self.assertIn(f": `{levels[0]}` to `{levels[-1]}`.", TEXT)

    def test_magic(self):
        shown = bytes.fromhex(re.search(r"Magic number\(s\): `([0-9A-F ]+)` at byte 0", TEXT).group(1))
        for path in STREAMS:
            self.assertEqual(path.read_bytes()[:8], shown)
        for path in (MAGIC, XML):
            strings = re.findall(r"\\x89L4D\S*?(?=[\s\"])", path.read_text("utf-8"))
            self.assertEqual([s.encode().decode("unicode_escape").encode("latin-1") for s in strings],
                             [shown], path)


class Programs(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    @wants("file")
    def test_file_recognises_streams(self):
        self.assertGreater(len(STREAMS), 3)
        for path in STREAMS:
            self.assertEqual(run("file", "-m", MAGIC, "-b", path).strip(),
                             "L4D scene of moving Gaussian splats, version 1.0, not final")
            self.assertEqual(run("file", "-m", MAGIC, "-b", "--mime-type", path).strip(), TYPE)
            self.assertEqual(run("file", "-m", MAGIC, "-b", "--extension", path).strip(), EXTENSION)

    @wants("file")
    def test_file_tells_others_apart(self):
        data = STREAMS[0].read_bytes()
        frozen, text_mode = self.folder / "frozen", self.folder / "text_mode"
        frozen.write_bytes(data[:9] + b"\x07\x00" + data[11:])
        self.assertIn(", version 1.7", run("file", "-m", MAGIC, "-b", frozen))
        self.assertNotIn("not final", run("file", "-m", MAGIC, "-b", frozen))
        text_mode.write_bytes(data.replace(b"\r\n", b"\n", 1))
        self.assertNotIn("L4D", run("file", "-m", MAGIC, "-b", text_mode))

    @wants("update-mime-database")
    def test_shared_mime_info_takes_the_type(self):
        packages = self.folder / "mime" / "packages"
        packages.mkdir(parents=True)
        shutil.copy(XML, packages)
        out = subprocess.run(["update-mime-database", self.folder / "mime"], capture_output=True,
                             text=True, check=True)
        self.assertNotIn("rror", out.stderr)
        read = lambda name: (self.folder / "mime" / name).read_bytes()
        self.assertIn(f":{TYPE}:*.{EXTENSION}\n".encode(), read("globs2"))
        self.assertIn(f"model/vnd.l4d {TYPE}\n".encode(), read("aliases"))
        self.assertIn(f":{TYPE}]\n>0=\0\x08".encode() + STREAMS[0].read_bytes()[:8], read("magic"))

    def test_xml(self):
        root = xml.etree.ElementTree.parse(XML).getroot()
        name = "{http://www.freedesktop.org/standards/shared-mime-info}"
        self.assertEqual(root.tag, name + "mime-info")
        self.assertEqual([e.get("type") for e in root.findall(name + "mime-type")], [TYPE])
        self.assertEqual([e.get("pattern") for e in root.iter(name + "glob")], [f"*.{EXTENSION}"])


if __name__ == "__main__":
    result = unittest.main(exit=False).result
    sys.exit(1 if not result.wasSuccessful() else 77 if result.skipped else 0)

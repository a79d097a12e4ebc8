#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Digests of appendix F: what the tool prints against what the reference decoder works out, which was
written from the specification, hash included, and against what the appendix shows.

  digests_test.py L4DCODEC ENCODE_SCENE
"""

import json
import re
import struct
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

sys.dont_write_bytecode = True
sys.path.insert(0, str(Path(__file__).resolve().parent))

import generator_path           # noqa: E402, F401
import random_stream            # noqa: E402
import stream_builder as sb     # noqa: E402
import digests                  # noqa: E402
import levels                   # noqa: E402
from decoder import Decoder, Query      # noqa: E402
from header import F16          # noqa: E402
from xxh3 import xxh3_64        # noqa: E402

APPENDIX = (sb.ROOT / "spec" / "l4d.md").read_text(encoding="utf-8").split("## Appendix F.")[1].split(
    "\n## ")[0]
TINY = sb.ROOT / "spec" / "examples" / "tiny.l4d"
NUM_RANDOM_STREAMS = 30
NUM_PACKED_STREAMS = 16
PROGRAMS = {}


def tool(path, *arguments):
    """name -> digest, in the order in which the tool has them."""
    out = subprocess.run([PROGRAMS["tool"], "decode", path, "--digest", "--json", *arguments],
                         capture_output=True, text=True, check=False)
    document = json.loads(out.stdout)
    if out.returncode != 0:
        raise AssertionError(document["error"]["message"])
    found = document["digests"]
    return {**{a["name"]: a["digest"] for a in found["arrays"]}, "all": found["all"]}


def queries(decoder):
    """Name, the tool's options, Query."""
    begin = decoder.header["time_begin"]
    a, b, c = (begin + share * decoder.duration for share in (0.21, 0.48, 0.9))
    at = lambda option, t: f"--{option}={t!r}"
    base = ["--detail", "base"]
    return [("all", [], Query()),
            ("base", base, Query(base_only=True)),
            ("level", ["--max-level", "1"], Query(most_level=1)),
            ("tier", ["--max-tier", "1"], Query(most_tier=1)),
            ("time", [at("time", a)], Query(a, a)),
            ("late", [at("time", c), "--max-level", "2"], Query(c, c, most_level=2)),
            ("range", [at("from", a), at("to", b), *base], Query(a, b, base_only=True))]


def is_indexed(data):
    return levels.keeps_profile(Decoder(data).header, levels.INDEXED)


class Digests(unittest.TestCase):
    def compare(self, files, form):
        """Holds the tool against the reader; returns how often each query selected less than all."""
        reader, options = ((digests.of_packed_form, ["--packed"]) if form == "packed" else
                           (digests.of_attributes, []))
        fewer = {}
        with tempfile.TemporaryDirectory() as folder:
            path = f"{folder}/stream.l4d"
            for name, data in files.items():
                Path(path).write_bytes(data)
                decoder, whole = Decoder(data), None
                for query, arguments, wanted in queries(decoder):
                    want = reader(decoder, wanted)
                    whole = whole or want
                    self.assertEqual(list(tool(path, *arguments, *options).items()),
                                     list(want.items()), f"{name}, {query}, {form}")
                    fewer[query] = fewer.get(query, 0) + (want["all"] != whole["all"])
        return fewer

    def test_attributes_of_random_streams(self):
        files = {}
        for seed in range(NUM_RANDOM_STREAMS):
            drawn = random_stream.RandomScene(seed)
            for index, layer in enumerate(drawn.scene["layers"]):
                layer["tier"] = index % 3
            files[seed] = drawn.build()
        fewer = self.compare(files, "attributes")
        for query in ("base", "level", "tier", "time", "late", "range"):
            self.assertGreater(fewer[query], NUM_RANDOM_STREAMS // 10, query)

    def test_packed_form_of_random_streams(self):
        files, stages, escapes, rans_pages = {}, 0, 0, 0
        for seed in range(100 * NUM_PACKED_STREAMS):
            drawn = random_stream.RandomScene(seed)
            if drawn.scene["position"] != F16 or drawn.may_be_raw:
                continue
            data = drawn.build()
            if not is_indexed(data):
                continue
            files[seed] = data
            layers = [layer for layer in drawn.scene["layers"] if layer["pages"]]
            codebooks = [drawn.scene["sh"]] + [layer["scale"] for layer in layers]
            stages += any(len(codebook.get("stages", ())) > 1 for codebook in codebooks)
            escapes += any(codebook.get("escapes", False) for codebook in codebooks)
            rans_pages += any(page.get("codec") == 2 for layer in layers for page in layer["pages"])
            if len(files) == NUM_PACKED_STREAMS:
                break
        self.assertEqual(len(files), NUM_PACKED_STREAMS)
        for count in (stages, escapes, rans_pages):
            self.assertGreater(count, NUM_PACKED_STREAMS // 5)
        fewer = self.compare(files, "packed")
        self.assertGreater(min(fewer["time"], fewer["range"], fewer["level"]), 1)

    def test_streams_of_the_encoder(self):
        files = {}
        with tempfile.TemporaryDirectory() as folder:
            for preset in ("default", "indexed", "lossless"):
                path = f"{folder}/{preset}.l4d"
                subprocess.run([PROGRAMS["encode_scene"], preset, path], check=True)
                files[preset] = Path(path).read_bytes()
        self.compare(files, "attributes")
        fewer = self.compare({"indexed": files["indexed"]}, "packed")
        self.assertEqual(fewer["time"], 1)

    def test_the_worked_example_of_the_appendix(self):
        decoder = Decoder(TINY.read_bytes())
        for form, reader, options in (("attributes", digests.of_attributes, []),
                                      ("packed", digests.of_packed_form, ["--packed"])):
            shown = dict(re.findall(rf"^\| {form} \| `(\S+)` \| `([0-9a-f]{{16}})` \|", APPENDIX, re.M))
            self.assertEqual(shown, reader(decoder, Query()), form)
            self.assertEqual(shown, tool(str(TINY), *options), form)

    def test_hashes_of_the_appendix(self):
        rows = re.findall(r"^\| (\d+) \| `([0-9a-f]{16})` \|", APPENDIX, re.M)
        self.assertGreater(len(rows), 15)
        for length, want in rows:
            data = bytes(i * 31 % 251 for i in range(int(length)))
            self.assertEqual(f"{xxh3_64(data):016x}", want, length)

    def test_a_raw_file_holds_what_is_hashed(self):
        for form in ([], ["--packed"]):
            with tempfile.TemporaryDirectory() as folder:
                path = f"{folder}/tiny.safetensors"
                subprocess.run([PROGRAMS["tool"], "decode", str(TINY), "--format", "raw", "-o", path, "-q",
                                *form], check=True)
                data = Path(path).read_bytes()
            length = struct.unpack("<Q", data[:8])[0]
            header, body = json.loads(data[8:8 + length]), data[8 + length:]
            self.assertEqual(header.pop("__metadata__")["byte_order"], "little")
            want = tool(str(TINY), *form)
            end = 0
            for name, array in header.items():     # in the order of their places, without gaps
                begin, end_of_array = array["data_offsets"]
                width = int(array["dtype"][1:]) // 8
                count = 1
                for n in array["shape"]:
                    count *= n
                self.assertEqual((begin, end_of_array), (end, end + width * count), name)
                self.assertEqual((8 + length + begin) % width, 0, name)
                end = end_of_array
                self.assertEqual(f"{xxh3_64(body[begin:end]):016x}", want[name], name)
            self.assertEqual(end, len(body))
            self.assertEqual(header.keys(), want.keys() - {"all"})


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    PROGRAMS["tool"], PROGRAMS["encode_scene"] = sys.argv[1:]
    unittest.main(argv=sys.argv[:1])

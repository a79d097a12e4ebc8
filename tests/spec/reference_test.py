#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The decoder of conformance/reference by itself: reference_test.py"""

import ast
import json
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

sys.dont_write_bytecode = True

import generator_path           # its import makes the following ones possible
import stream_builder as sb
import broken_rans
import digests
import random_stream
import zstd
from arithmetic import Invalid
from broken_streams import FIRST, broken, scene
from decoder import Decoder, Query
from validate import validate
from xxh64 import xxh64

# Made by the zstd tool, version 1.5: TEXT at level 19, nothing, and a run of zeros.
FRAME = bytes.fromhex(
    "28b52ffd0468c50a0076d431189029c5060841a13d7278f9b65d887522bbbb77caa2d71fe438002600250047bd8d"
    "83aec9e92cc061181408864a110e0c4d18c6d1e35082445129c2583010351c549a60140c28083471e8611c109526"
    "8ac37128140101e934c334df4749e432deb7532c6292b4f17caf895f531acf50c74caefa2bcb5c2a3bcb0e5e05a6"
    "b1dd3551dccbdec756fd6d5cf4d12fb99a47c1b1d936a2934f9578999bd587e4eab7c2b32d9990e89d3fd33e9636"
    "619d5c66ab8bd1133df7a1db50c8968924b75c995e7619a1fdb97c78a8111051dbfd7f03302f33d50112584121b8"
    "57002ac243fafe068b87cad1ee97f98b9259b2cee500d48a649bfe0172e8fe8756b9d5b7e67a3378dcb8a9855603"
    "07017e772c0616719fdab29386180daa9064137dbbde82c0b976b2daea27145c1c09ee203befa055f43beb59ebf9"
    "0afe556d9a616d455e44953109a68ea142c7d4f208eaf1325efd0404e057016d11171b")
EMPTY = bytes.fromhex("28b52ffd240001000099e9d851")
ZEROS = bytes.fromhex("28b52ffd04584d00001000000100e32b80055a074479")
TEXT = b"".join(
    b"Gaussian %d lies in bucket %d of level %d and is seen for %d frames. " %
    (i * 7919 % 1000, i * 31 % 17, i % 5, i * i % 300) for i in range(40))

CONFORMANCE = generator_path.ROOT / "conformance"


class Independence(unittest.TestCase):
    def test_nothing_is_imported_but_the_standard_library_and_neighbours(self):
        reference = {p.stem for p in (CONFORMANCE / "reference").glob("*.py")}
        # What writes streams may use what reads them, and not the other way round.
        writers = reference | {p.stem for p in (CONFORMANCE / "generate").glob("*.py")} | {
            p.stem for p in (sb.ROOT / "spec" / "examples").glob("*.py")} | {"must_table"}
        files = sorted(CONFORMANCE.rglob("*.py"))
        self.assertGreater(len(files), 30)
        for path in files:
            neighbours = reference if path.parent.name == "reference" else writers
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                names = ([alias.name for alias in node.names] if isinstance(node, ast.Import) else
                         [node.module] if isinstance(node, ast.ImportFrom) else [])
                for name in names:
                    known = name.split(".")[0] in sys.stdlib_module_names or name in neighbours
                    self.assertTrue(known and name != "ctypes", f"{path} imports {name}")


class Zstd(unittest.TestCase):
    def test_frames_of_another_writer(self):
        for frame, text in ((FRAME, TEXT), (EMPTY, b""), (ZEROS, bytes(1000))):
            self.assertEqual(zstd.decompress(frame, len(text)), text)

    def test_raw_and_rle_blocks(self):
        head = bytes.fromhex("28b52ffd0058")        # a window of 2 MiB, no checksum
        block = lambda last, kind, n, data: (last + 2 * kind + 8 * n).to_bytes(3, "little") + data
        frame = head + block(0, 0, 3, b"abc") + block(0, 1, 5, b"x") + block(1, 0, 0, b"")
        self.assertEqual(zstd.decompress(frame, 8), b"abcxxxxx")
        for bad in (frame[:-1], frame + b"x", head + block(1, 3, 0, b""),
                    head + block(1, 1, (1 << 17) + 1, b"x"), b"\0" + frame[1:],
                    bytes.fromhex("28b52ffd0099") + frame[6:], bytes.fromhex("28b52ffd0858") + frame[6:]):
            with self.assertRaises(Invalid) as caught:
                zstd.decompress(bad, 1 << 20)
            self.assertEqual(caught.exception.clause, "CHNK-5")
        with self.assertRaises(Invalid):
            zstd.decompress(frame, 7)

    # spec: CHNK-5
    def test_a_checksum_finds_every_changed_bit(self):
        for i in range(8 * len(FRAME)):
            changed = bytearray(FRAME)
            changed[i // 8] ^= 1 << i % 8
            try:
                self.assertEqual(zstd.decompress(bytes(changed), len(TEXT)), TEXT, f"bit {i}")
            except Invalid as error:
                self.assertEqual(error.clause, "CHNK-5")

    def test_xxh64(self):
        self.assertEqual(xxh64(b""), 0xEF46DB3751D8E999)
        self.assertEqual(xxh64(b"abc"), 0x44BC2CF5AD770999)


class Offsets(unittest.TestCase):
    def test_each_refusal_names_a_byte(self):
        for name, data in {**dict(broken()), **dict(broken_rans.broken())}.items():
            with self.subTest(name):
                try:
                    list(Decoder(data).gaussians())
                except Invalid as error:
                    self.assertIsNotNone(error.offset)
                    inside = error.clause == "CHNK-1" or 0 <= error.offset <= len(data)
                    self.assertTrue(inside, error.offset)


class Validation(unittest.TestCase):
    def test_valid_streams(self):
        for name, data in {"scene": sb.build(scene(), rng=FIRST), **dict(broken_rans.valid())}.items():
            with self.subTest(name):
                validate(Decoder(data))

    # spec: CHNK-4, DIR-9, DIR-10, LAYR-1
    def test_each_broken_rule_is_named(self):
        files = {**dict(broken()), **dict(broken_rans.broken())}
        for name, data in files.items():
            with self.subTest(name), self.assertRaises(Invalid) as caught:
                validate(Decoder(data))
            with self.subTest(name):
                self.assertEqual(caught.exception.clause, name.split()[0])


class Queries(unittest.TestCase):
    def test_all_buckets_are_everything(self):
        fewer = 0
        for seed in range(0, 60, 6):
            decoder = Decoder(random_stream.RandomScene(seed).build())
            whole = digests.of_attributes(decoder, Query())
            used = sorted({(s.index, s.record["bucket"]) for s in decoder.select(Query())})
            self.assertEqual(digests.of_attributes(decoder, Query(buckets=used)), whole, seed)
            h, width = decoder.header, decoder.duration
            everything = Query(h["time_begin"] - 1, h["time_begin"] + width + 1, whole_buckets=True)
            some = Query(h["time_begin"], h["time_begin"])
            count = lambda query: sum(s.record["num_gaussians"] for s in decoder.select(query))
            self.assertLessEqual(count(some), count(everything))
            self.assertLessEqual(count(everything), h["num_gaussians"])
            fewer += count(some) < h["num_gaussians"]
            least = min((la["level"] for la in h["layers"]), default=0)
            coarse = [s for s in decoder.select(Query(most_level=least))]
            self.assertTrue(all(h["layers"][s.index]["level"] == least for s in coarse))
        self.assertGreater(fewer, 2)


class CommandLine(unittest.TestCase):
    def run_it(self, *arguments):
        program = CONFORMANCE / "reference" / "l4d.py"
        out = subprocess.run([sys.executable, "-B", str(program), *map(str, arguments)],
                             capture_output=True, text=True, check=False)
        return out.returncode, json.loads(out.stdout) if out.stdout else None

    def test_answers(self):
        tiny = sb.ROOT / "spec" / "examples" / "tiny.l4d"
        for options in ((), ("--query", "time:1.25"), ("--query", "range:1:1.5"),
                        ("--query", "buckets:0/0"), ("--level", 0), ("--detail", "base")):
            status, out = self.run_it(tiny, *options)
            self.assertEqual((status, out["num_gaussians"]), (0, 3), options)
            self.assertEqual(out["digests"], digests.of_attributes(Decoder(tiny.read_bytes()), Query()))
        self.assertEqual(self.run_it(tiny, "--query", "buckets:")[1]["num_gaussians"], 0)
        status, out = self.run_it(tiny, "--packed")
        self.assertEqual((status, len(out["digests"])), (0, 18))
        self.assertEqual(self.run_it(tiny, "--query", "validate"), (0, {"valid": True}))
        self.assertEqual(self.run_it(tiny, "--query", "demand")[1]["demand"]["gaussians"], 3)
        self.assertEqual(self.run_it(tiny, "--query", "header")[1]["header"]["fps_num"], 4)
        for query in ("x", "time:", "range:2:1", "buckets:1", "buckets:0/1,0/0"):
            self.assertEqual(self.run_it(tiny, "--query", query), (2, None), query)

    def test_refusals(self):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "broken.l4d"
            path.write_bytes(dict(broken())["FILE-2"])
            status, out = self.run_it(path)
            self.assertEqual((status, out["refused"], out["offset"]), (1, "FILE-2", 8))
            path.write_bytes(dict(broken())["VAL-3"])
            status, out = self.run_it(path, "--packed")
            self.assertEqual((status, out), (0, {"unavailable": "packed"}))


if __name__ == "__main__":
    unittest.main()

#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Two readers of the format against each other: the library, and conformance/reference, which was
written from the specification alone.

  streams_test.py DUMP_VALUES ENCODE_SCENE
      the programs built from dump_values.cc and encode_scene.cc
  streams_test.py --write
      writes the dump of the worked example into l4d.md
"""

import math
import resource
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

sys.dont_write_bytecode = True
sys.path.insert(0, str(Path(__file__).resolve().parent))

import generator_path           # noqa: E402, F401
import broken_levels            # noqa: E402
import broken_rans              # noqa: E402
import random_stream            # noqa: E402
import stream_builder as sb     # noqa: E402
import decode_tiny              # noqa: E402
import levels                   # noqa: E402
import member_files             # noqa: E402
import make_tiny                # noqa: E402
from arithmetic import Invalid  # noqa: E402
from broken_streams import FIRST, broken, edited, flat_scene, scene     # noqa: E402
from decoder import Decoder, Query  # noqa: E402
import validate                 # noqa: E402
from xxh3 import xxh3_64        # noqa: E402

SPEC = sb.ROOT / "spec" / "l4d.md"
TINY = sb.ROOT / "spec" / "examples" / "tiny.l4d"
BEGIN = "<!-- dump: written by tests/spec/streams_test.py -->\n"
END = "<!-- end of dump -->"
PROGRAMS = {}
MEMORY = 2 << 30                      # what a reader believes before it checks would not fit
NUM_RANDOM_STREAMS = 150
# What the independent reader refuses and a validator has no eye for, or the other way round.
LIBRARY_ONLY = {"FILE-7", "HEAD-21", "CHNK-5", "DIR-9", "DIR-10", "LAYR-1", "LAYR-3",
                *(f"MEMB-{k}" for k in range(1, 12))}
READER_ONLY = {"HEAD-6 none", "HEAD-12 many", "HEAD-13", "HEAD-14", "CHNK-1 wrap", "RCQ-5",
               "DIR-11", "DIR-12", "VAL-3", "HEAD-8 needs"}


def library(mode, files):
    """name -> lines of dump_values for each of {name: bytes}."""
    with tempfile.TemporaryDirectory() as folder:
        paths = []
        for i, data in enumerate(files.values()):
            paths.append(f"{folder}/{i}.l4d")
            Path(paths[-1]).write_bytes(data)
        limit = lambda: resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY))
        out = subprocess.run([PROGRAMS["dump_values"], mode, *paths], capture_output=True,
                             text=True, check=True, preexec_fn=limit).stdout
    parts = out.split("file " + folder)[1:]
    return {name: part.split("\n")[1:-1] for name, part in zip(files, parts)}


def appendix():
    file, gaussians = decode_tiny.decode(TINY.read_bytes())
    lines = [*decode_tiny.dump(file), "", *decode_tiny.decimals(gaussians)]
    return "```\n" + "\n".join(lines) + "\n```\n"


def visible(g, t, h):
    """Section 15.3, from the decoded values, for a Gaussian that is not permanent."""
    a, b = halves_of(g["rotor"])
    products = [-a[0] * b[3] + a[3] * b[0] - a[1] * b[2] + a[2] * b[1],
                a[0] * b[2] - a[2] * b[0] - a[1] * b[3] + a[3] * b[1],
                -a[0] * b[1] + a[1] * b[0] - a[2] * b[3] + a[3] * b[2],
                sum(x * y for x, y in zip(a, b))]
    variance = sum((p * math.exp(s)) ** 2 for p, s in zip(products, g["log_scale"]))
    return (t - g["mean_t"][0]) ** 2 / max(variance, 1e-12) <= h["gate"]


def halves_of(r):
    s, b01, b02, b12, b03, b13, b23, p = r
    for v in ([s + p, b01 - b23, b02 + b13, b12 - b03], [s - p, b01 + b23, b02 - b13, b12 + b03]):
        norm = math.sqrt(sum(x * x for x in v))
        yield [x / norm for x in v]


class WorkedExample(unittest.TestCase):
    def test_checksum(self):
        vectors = {0: 0x2D06800538D394C2, 1: 0xC44BDFF4074EECDB}
        data = bytes(1)
        self.assertEqual(xxh3_64(b""), vectors[0])
        self.assertEqual(xxh3_64(data), vectors[1])

    def test_file_is_what_its_generator_makes(self):
        self.assertEqual(TINY.read_bytes(), make_tiny.make())

    def test_specification_shows_the_file(self):
        text = SPEC.read_text(encoding="utf-8")
        begin, end = text.index(BEGIN) + len(BEGIN), text.index(END)
        self.assertEqual(text[begin:end], appendix(), "run streams_test.py --write")

    # spec: DEC-1, DEC-2, STRM-5, PAGE-2
    def test_library_decodes_the_same_bits(self):
        _, gaussians = decode_tiny.decode(TINY.read_bytes())
        self.assertEqual(len(gaussians), 3)
        for mode in ("reference", "cpu"):
            self.assertEqual(library(mode, {"tiny": TINY.read_bytes()})["tiny"],
                             decode_tiny.values(gaussians))
        self.assertEqual(library("validate", {"tiny": TINY.read_bytes()})["tiny"], [])

    # spec: CHNK-2, FILE-4, FILE-6, DIR-1
    def test_every_bit_is_under_a_checksum(self):
        data = TINY.read_bytes()
        files = {}
        for i in range(len(data)):
            changed = bytearray(data)
            changed[i] ^= 1 << i % 8
            files[i] = bytes(changed)
            with self.assertRaises(Invalid):
                decode_tiny.decode(files[i])
        for i, lines in library("cpu", files).items():
            self.assertTrue(lines and lines[0].startswith("error"), f"byte {i}: {lines[:1]}")


class RandomStreams(unittest.TestCase):
    # spec: DEC-1, DEC-2, STRM-5, PAGE-2, PAGE-3, VER-1, VER-2
    def test_two_readers_agree_on_every_bit(self):
        files, want, rans_pages = {}, {}, 0
        for seed in range(NUM_RANDOM_STREAMS):
            drawn = random_stream.RandomScene(seed)
            rans_pages += sum(page.get("codec") == 2 for layer in drawn.scene["layers"]
                              for page in layer["pages"])
            files[seed] = drawn.build()
            file, gaussians = decode_tiny.decode(files[seed])
            decode_tiny.dump(file)        # no byte is read twice
            want[seed] = decode_tiny.values(gaussians)
        self.assertGreater(rans_pages, NUM_RANDOM_STREAMS)
        for mode in ("reference", "cpu"):
            got = library(mode, files)
            for seed in files:
                self.assertEqual(got[seed], want[seed], f"seed {seed}, {mode}")

    # spec: DEC-7
    def test_two_readers_agree_on_the_base(self):
        files, want, whole, seconds = {}, {}, 0, 0
        for seed in range(0, NUM_RANDOM_STREAMS, 2):
            drawn = random_stream.RandomScene(seed)
            seconds += sum(bool(page.get("detail")) for layer in drawn.scene["layers"]
                           for page in layer["pages"])
            files[seed] = drawn.build()
            _, gaussians = decode_tiny.decode(files[seed], base=True)
            want[seed] = decode_tiny.values(gaussians)
            _, gaussians = decode_tiny.decode(files[seed])
            whole += decode_tiny.values(gaussians) == want[seed]
        self.assertGreater(seconds, NUM_RANDOM_STREAMS // 4)
        self.assertLess(whole, len(files) - NUM_RANDOM_STREAMS // 20)
        for seed, lines in library("base", files).items():
            self.assertEqual(lines, want[seed], f"seed {seed}")

    # spec: LAYR-2, DEC-2
    def test_two_readers_select_the_same_at_a_time(self):
        fewer = 0
        for seed in range(0, NUM_RANDOM_STREAMS, 5):
            data = random_stream.RandomScene(seed).build()
            decoder = Decoder(data)
            begin, end = decoder.header["time_begin"], decoder.header["time_begin"] + decoder.duration
            for t in (begin - 1, begin, begin + 0.31 * (end - begin), end):
                want = decode_tiny.values(decoder.gaussians(Query(t, t)))
                self.assertEqual(library(repr(t), {seed: data})[seed], want, f"seed {seed}, t = {t}")
                fewer += len(want) < len(decode_tiny.values(decoder.gaussians()))
        self.assertGreater(fewer, NUM_RANDOM_STREAMS // 10)


class BrokenStreams(unittest.TestCase):
    def test_the_unbroken_streams_are_valid(self):
        files = {"scene": sb.build(scene(), rng=FIRST), "flat": sb.build(flat_scene(), rng=FIRST),
                 **dict(broken_rans.valid()), **{name: data for name, _, data, _ in member_files.valid()}}
        violations, values = library("validate", files), library("cpu", files)
        for name, data in files.items():
            _, gaussians = decode_tiny.decode(data)
            self.assertEqual(violations[name], [], name)
            self.assertEqual(values[name], decode_tiny.values(gaussians), name)

    # Streams that break one rule, checksums repaired; both readers name the rule.
    # spec: FILE-1, FILE-2, FILE-3, FILE-4, FILE-5, FILE-6, FILE-7
    # spec: HEAD-1, HEAD-2, HEAD-3, HEAD-4, HEAD-5, HEAD-6, HEAD-7, HEAD-8, HEAD-9, HEAD-10, HEAD-11
    # spec: HEAD-12, HEAD-13, HEAD-14, HEAD-15, HEAD-16, HEAD-17, HEAD-18, HEAD-19, HEAD-20
    # spec: CODE-1, CODE-2, CODE-3, CODE-4, CODE-5, CODE-6, CODE-7
    # spec: TIME-1, TIME-2
    # spec: TRAN-1, TRAN-2, TRAN-3, TRAN-4, TRAN-5, TRAN-6, TRAN-7, TRAN-8
    # spec: RANS-1, RANS-2, RANS-3, RANS-4, RANS-5, RANS-6, RANS-7, RANS-8
    # spec: CHNK-1, CHNK-2, CHNK-3, CHNK-4, CHNK-5, CHNK-6, CHNK-7, CHNK-8
    # spec: STRM-1, STRM-2, STRM-3, STRM-4, STRM-6, RCQ-1, RCQ-2, RCQ-3, RCQ-4, RCQ-5
    # spec: DIR-1, DIR-2, DIR-3, DIR-4, DIR-5, DIR-6, DIR-7, DIR-8, DIR-9, DIR-10, DIR-11, DIR-12
    # spec: DIR-13
    # spec: PAGE-1, VQ-1, VQ-2, VAL-1, VAL-2, VAL-3, VAL-4, LAYR-1, LAYR-3, WIND-1
    # spec: WIND-2, WIND-3, DEC-3, HEAD-21
    # spec: MEMB-1, MEMB-2, MEMB-3, MEMB-4, MEMB-5, MEMB-6, MEMB-7, MEMB-8, MEMB-9, MEMB-10, MEMB-11
    def test_each_broken_rule_is_named(self):
        files = {**dict(broken()), **dict(broken_rans.broken()), **dict(member_files.broken())}
        for name, data in files.items():
            if name.split()[0] in LIBRARY_ONLY:
                continue
            with self.subTest(name), self.assertRaises(Invalid) as caught:
                decode_tiny.decode(data)
            with self.subTest(name):
                self.assertEqual(caught.exception.clause, name.split()[0])
        checked = {n: d for n, d in files.items() if not {n, n.split()[0]} & READER_ONLY}
        for name, lines in library("validate", checked).items():
            with self.subTest(name):
                self.assertIn("violation " + name.split()[0], lines)

    # spec: DEC-4, DEC-5, DEC-6
    def test_errors_are_told_apart(self):
        want = {"FILE-1 magic": "NOT_L4D", "FILE-1 short": "TRUNCATED",
                "FILE-2": "VERSION_UNSUPPORTED", "FILE-3": "FEATURE_UNSUPPORTED",
                "HEAD-7 scalar": "FEATURE_UNSUPPORTED", "HEAD-8": "FEATURE_UNSUPPORTED",
                "CHNK-6": "FEATURE_UNSUPPORTED", "CHNK-1": "TRUNCATED", "CHNK-1 size": "TRUNCATED",
                "CHNK-2": "CHECKSUM", "PAGE-1": "CORRUPT", "VQ-2": "CORRUPT",
                "HEAD-7 mean_t unknown": "FEATURE_UNSUPPORTED",
                "TIME-1": "CORRUPT", "TIME-2": "CORRUPT",
                "HEAD-16 position": "CORRUPT", "HEAD-16 raw64": "CORRUPT",
                "CHNK-6 rans codebook": "FEATURE_UNSUPPORTED", "CHNK-2 entropy": "CHECKSUM",
                "HEAD-15 spatial": "CORRUPT", "CODE-5": "CORRUPT", "CODE-6": "CORRUPT", "CODE-7": "CORRUPT",
                **{f"TRAN-{k}": "CORRUPT" for k in range(1, 9)},
                "DIR-13": "CORRUPT",
                "RANS-1 map": "CORRUPT", "RANS-2": "CORRUPT", "RANS-3": "CORRUPT",
                "RANS-4 wide": "CORRUPT", "RANS-5": "CORRUPT", "RANS-6 entropy": "CORRUPT",
                "RANS-7": "CORRUPT", "RANS-8": "CORRUPT"}
        files = {name: data for name, data in [*broken(), *broken_rans.broken()] if name in want}
        self.assertEqual(files.keys(), want.keys())
        files["limit"] = edited(lambda s: (s.update(num_gaussians=1 << 31),
                                           s["layers"][0].update(num_gaussians=(1 << 31) - 6)))
        want["limit"] = "LIMIT_EXCEEDED"
        for name, lines in library("cpu", files).items():
            self.assertEqual(len(lines), 1, name)
            self.assertEqual(lines[0].split()[1], "L4D_ERR_" + want[name], name)


class Levels(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.valid = dict(broken_levels.valid())

    def decoder(self, data):
        return Decoder(data)

    # spec: LEVL-1, LEVL-2, LEVL-3, LEVL-4, LEVL-5, LEVL-6, LEVL-7, LEVL-8, LEVL-9, LEVL-10, LEVL-11
    def test_each_broken_rule_is_named_and_no_other(self):
        files = dict(broken_levels.broken())
        for name, lines in library("validate", files).items():
            with self.subTest(name), self.assertRaises(Invalid) as caught:
                # What pages hold is not seen from the directory.
                check = validate.validate if name == "LEVL-9" else levels.check
                check(self.decoder(files[name]))
            with self.subTest(name):
                self.assertEqual(caught.exception.clause, name.split()[0])
                self.assertEqual(lines, ["violation " + name.split()[0]])

    def test_streams_of_their_level(self):
        for name, lines in library("validate", self.valid).items():
            self.assertEqual(lines, [], name)
            levels.check(self.decoder(self.valid[name]))

    def test_both_readers_measure_the_same(self):
        files = {seed: random_stream.RandomScene(seed).build()
                 for seed in range(0, NUM_RANDOM_STREAMS, 3)}
        files.update(self.valid)
        bursts = 0
        for name, lines in library("demand", files).items():
            decoder = self.decoder(files[name])
            want, got = levels.demand(decoder), {k: int(v) for k, v in map(str.split, lines)}
            h = decoder.header
            profiles = [p for p in (1, 2, 3) if levels.keeps_profile(h, p)]
            self.assertEqual(got["profile"], min(profiles, default=0), name)
            for key in ("gaussians", "table_bytes", "instant_bytes", "start_bytes", "memory_bytes",
                        "symbols"):
                self.assertEqual(got[key], getattr(want, key), f"{name} {key}")
            self.assertLessEqual(abs(got["burst_bytes"] - want.burst(1000)), 1, name)
            bursts += got["burst_bytes"] > 0
            for level in range(1, got["level"] + 1):
                fits = True
                try:
                    want.check_level(level)
                except Invalid:
                    fits = False
                self.assertEqual(fits, level == got["level"], f"{name} level {level}")
        self.assertGreater(bursts, NUM_RANDOM_STREAMS // 12)


class Queries(unittest.TestCase):
    # spec: LAYR-2
    def test_a_time_gives_all_that_is_visible(self):
        data = sb.build(scene(), rng=FIRST)
        file, gaussians = decode_tiny.decode(data)
        header = Decoder(data).header

        def by_gaussian(lines):
            """The values of each Gaussian, its number left out."""
            out = {}
            for line in lines:
                name, i, k, bits = line.split()
                out.setdefault(int(i), []).append(f"{name} {k} {bits}")
            return out

        want = by_gaussian(decode_tiny.values(gaussians))
        some_left_out = False
        for step in range(-4, 69):
            t = 1.0 + step / 128
            clamped = min(max(t, 1.0), 1.5)
            got = list(by_gaussian(library(repr(t), {0: data})[0]).values())
            for i, g in enumerate(gaussians):
                if i < 3 or visible(g, clamped, header):    # the first three are permanent
                    self.assertIn(want[i], got, f"t = {t}, Gaussian {i}")
            some_left_out = some_left_out or len(got) < 9
        self.assertTrue(some_left_out)


class Encoder(unittest.TestCase):
    # spec: ENC-1, ENC-2, VER-3
    def test_encoded_streams_break_no_rule(self):
        with tempfile.TemporaryDirectory() as folder:
            files = {}
            for preset in ("default", "tiny", "archive", "indexed", "lossless"):
                path = f"{folder}/{preset}.l4d"
                subprocess.run([PROGRAMS["encode_scene"], preset, path], check=True)
                files[preset] = Path(path).read_bytes()
        for preset, lines in library("validate", files).items():
            self.assertEqual(lines, [], preset)
            self.assertEqual(files[preset][10] & 1, 1, "development bit")
            header = Decoder(files[preset]).header
            self.assertGreater(max(la["level"] for la in header["layers"]), 1)


def write():
    text = SPEC.read_text(encoding="utf-8")
    begin, end = text.index(BEGIN) + len(BEGIN), text.index(END)
    SPEC.write_text(text[:begin] + appendix() + text[end:], encoding="utf-8")


if __name__ == "__main__":
    if sys.argv[1:] == ["--write"]:
        write()
    elif len(sys.argv) != 3:
        sys.exit(__doc__)
    else:
        PROGRAMS["dump_values"], PROGRAMS["encode_scene"] = sys.argv[1:3]
        unittest.main(argv=sys.argv[:1])

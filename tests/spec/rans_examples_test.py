#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Appendix G of spec/l4d.md against its generator, conformance/reference, the code of section 13.3 and
the library: rans_examples_test.py TOOL DUMP_VALUES"""

import json
import subprocess
import sys
import unittest

sys.dont_write_bytecode = True

import rans_examples as examples    # its import makes the following ones possible
import decode_tiny
import digests
import rans
import rans_writer
from decoder import Decoder, Query
from file import Chunk, File
from rans_code_test import CODE, of_reference, pages, run_code
from streams import Streams
from validate import validate

PROGRAMS = {}


class Examples(unittest.TestCase):
    def test_files_and_text_are_what_the_generator_makes(self):
        text = examples.SPEC.read_text(encoding="utf-8")
        for name, make in examples.STREAMS.items():
            self.assertEqual((examples.FOLDER / name).read_bytes(), make(), name)
        for name, make in examples.PARTS.items():
            begin, end = examples.shown(text, name)
            self.assertEqual(text[begin:end], "\n".join(make()) + "\n",
                             f"{name}: run rans_examples.py --write")

    # spec: DEC-1, RANS-1, RANS-4, RANS-7
    def test_the_library_decodes_the_same_bits(self):
        for name in examples.STREAMS:
            path = examples.FOLDER / name
            data = path.read_bytes()
            _, gaussians = decode_tiny.decode(data)
            for mode in ("reference", "cpu"):
                out = subprocess.run([PROGRAMS["dump_values"], mode, path], capture_output=True,
                                     text=True, check=True).stdout
                self.assertEqual(out.splitlines()[1:], decode_tiny.values(gaussians), f"{name} {mode}")
            out = subprocess.run([PROGRAMS["tool"], "decode", path, "--digest", "--json"],
                                 capture_output=True, text=True, check=True).stdout
            got = json.loads(out)["digests"]
            got = {**{a["name"]: a["digest"] for a in got["arrays"]}, "all": got["all"]}
            self.assertEqual(got, digests.of_attributes(Decoder(data), Query()), name)

    def test_both_find_the_streams_valid(self):
        for name in examples.STREAMS:
            path = examples.FOLDER / name
            validate(Decoder(path.read_bytes()))
            subprocess.run([PROGRAMS["tool"], "validate", path, "-q"], check=True)

    def test_the_channel_is_what_the_page_decodes_to(self):
        _, gaussians = decode_tiny.decode((examples.FOLDER / "channel.l4d").read_bytes())
        self.assertEqual([g["opacity"][0] * 2 ** 16 for g in gaussians], examples.INTEGERS)

    def test_the_code_of_the_specification_reads_the_pages(self):
        for name in examples.STREAMS:
            for decoder, selected in pages((examples.FOLDER / name).read_bytes()):
                self.assertEqual(run_code(decoder, selected), of_reference(decoder, selected))


class Blocks(unittest.TestCase):
    def tables(self, kind):
        f = examples.uniform(126 if kind == "wide" else 112)
        # What the text says of them.
        self.assertEqual(set(f[:16]), {9 if kind == "wide" else 10})
        self.assertEqual(set(f[16:]), {8 if kind == "wide" else 9})
        self.assertEqual(sum(f), 1024)
        return f

    def test_blocks_of_the_table_decode_to_their_integers(self):
        for kind in ("hybrid", "wide"):
            f = self.tables(kind)
            table = rans.Table(Streams(File(b""), Chunk(rans_writer.table(f), 0)),
                               getattr(rans, kind), 126)
            for n in examples.LENGTHS:
                raw, want = examples.test_block(kind, n), examples.test_integers(kind, n)
                block = rans.Block(File(raw), Chunk(raw, 0), "")
                self.assertEqual(block.channel([table] * n), want)
                block.end()
                block = CODE["open_block"](raw)
                self.assertEqual(CODE["integers"](block, [f] * n, CODE[kind]), want)
                CODE["end_block"](block)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    PROGRAMS["tool"], PROGRAMS["dump_values"] = sys.argv[1:]
    unittest.main(argv=sys.argv[:1])

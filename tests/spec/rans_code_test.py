#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Runs the code of section 13.3 of spec/l4d.md, as it stands there, against conformance/reference:
rans_code_test.py

The streams are those of which streams_test.py shows that the library decodes them to the same bits."""

import re
import sys
import unittest

sys.dont_write_bytecode = True

import generator_path           # its import makes the following ones possible
import stream_builder as sb
import broken_rans
import header as ids
import random_stream
import rans_writer
from decoder import Decoder, Query
from file import RANS32
from rans import page_channels
from times import window_base

NUM_RANDOM_STREAMS = 150
BEGIN = "<!-- code: run by tests/spec/rans_code_test.py -->\n```\n"
END = "```\n<!-- end of code -->"


def code():
    """What the code of the specification defines."""
    text = (sb.ROOT / "spec" / "l4d.md").read_text(encoding="utf-8")
    source = text[text.index(BEGIN) + len(BEGIN):text.index(END)]
    names = {"little": lambda data, at, n: int.from_bytes(data[at:at + n], "little"),
             **{name: getattr(ids, name) for name in ("NONE", "FIXED", "WINDOW", "SQ", "VQ", "TRANSFORM")}}
    exec(compile(source, "spec/l4d.md", "exec"), names)     # pylint: disable=exec-used
    return names


CODE = code()


def pages(data):
    """(Decoder, Selected) of each rANS page of a stream."""
    decoder = Decoder(data)
    for selected in decoder.select(Query()):
        if selected.record["codec"] == RANS32:
            yield decoder, selected


def run_code(decoder, selected):
    h, record = decoder.header, selected.record
    layer, at = h["layers"][selected.index], h["payload_offset"]
    entropy = decoder.file.chunk(layer["entropy"], 1 << 32).raw
    channels = CODE["entropy_chunk"](entropy, [n for _, n in page_channels(h, selected.index)])
    base = decoder.file.data[at + record["offset"]:][:record["stored_bytes"]]
    detail = decoder.file.data[at + record["sh_offset"]:][:record["sh_bytes"]]
    return CODE["rans_page"](int(record["num_gaussians"]), h, layer, channels, base, detail or None)


def of_reference(decoder, selected):
    """The columns of a page in the form of the code."""
    page = decoder.page(selected)
    out = {"position": [list(column) for column in page.position]}
    for name in ("mean_t", "mean_t_fine", "opacity", "scale_factor"):
        if getattr(page, name) is not None:
            out[name] = getattr(page, name)
    if page.window is not None:
        layer, bucket = decoder.header["layers"][selected.index], selected.record["bucket"]
        base = window_base(decoder.header, layer["level"], bucket)
        out["window_begin"] = [begin - base for begin, _ in page.window]
        out["window_length"] = [end - begin - layer["window_length"] for begin, end in page.window]
    for number, columns in page.component.items():
        if columns:
            out[ids.COMPONENTS[number]] = tuple(columns.values())
    return out


class Code(unittest.TestCase):
    def test_decodes_every_page_as_the_reference_does(self):
        files = [random_stream.RandomScene(seed).build() for seed in range(NUM_RANDOM_STREAMS)]
        files += [data for _, data in broken_rans.valid()]
        count, split, kinds = 0, 0, set()
        for data in files:
            for decoder, selected in pages(data):
                got, want = run_code(decoder, selected), of_reference(decoder, selected)
                self.assertEqual(got, want)
                count += 1
                split += selected.record["sh_bytes"] > 0
                kinds |= got.keys()
        self.assertGreater(count, NUM_RANDOM_STREAMS)
        self.assertGreater(split, NUM_RANDOM_STREAMS // 5)
        self.assertEqual(kinds, {"position", "mean_t", "mean_t_fine", "window_begin",
                                 "window_length", "opacity", "scale_factor", "scale",
                                 "rotor_spatial", "rotor_temporal", "sh"})

    def test_notices_what_its_comments_say(self):
        one = [1024]                      # a table of one token
        channel = rans_writer.Channel("opacity", [0, 5, 900])
        table = rans_writer.fitted([1] * 112)
        good = rans_writer.block([channel], [[table]])
        tables = [table] * 3
        for clause, raw in (("RANS-1", good[:127]), ("RANS-3", bytes(4) + good[4:]),
                            ("RANS-7", good + b"\0\0")):
            with self.subTest(clause), self.assertRaises(AssertionError):
                block = CODE["open_block"](raw)
                CODE["integers"](block, tables, CODE["hybrid"])
                CODE["end_block"](block)
        for name, chunk in (("RANS-2", rans_writer.entropy_chunk([[4095]], 1, [[0]])),
                            ("CHNK-7", rans_writer.entropy_chunk([one], 1, [[0]]) + b"\0")):
            with self.subTest(name), self.assertRaises(AssertionError):
                CODE["entropy_chunk"](chunk, [1])

    def test_every_clause_that_it_names_exists(self):
        text = (sb.ROOT / "spec" / "l4d.md").read_text(encoding="utf-8")
        named = set(re.findall(r"[A-Z]{4}-\d+", text[text.index(BEGIN):text.index(END)]))
        self.assertGreater(len(named), 4)
        for clause in named:
            self.assertIn(f"- **{clause}**", text)


if __name__ == "__main__":
    unittest.main()

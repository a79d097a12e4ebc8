# SPDX-License-Identifier: Apache-2.0
"""Codebooks, bases and block codebooks, sections 10 and 11 of spec/l4d.md."""

from arithmetic import bit_width, f32, half, located, require, unorder, unzigzag
from header import (COMPONENTS, ROTOR_SPATIAL, ROTOR_TEMPORAL, SCALE, SH, VQ, component,
                    vector_length)
from rans import Entropy, page_channels
from streams import Streams

RESIDUAL, BASIS = 8, 9              # stand for stages


class Codebooks:
    """What pages are decoded with, read when it is first asked for."""

    def __init__(self, file, header):
        self.file, self.header = file, header
        self.codebooks, self.entropies = {}, {}

    def stage(self, layer, c, stage):
        coding = component(self.header, layer, c)
        return (coding["basis"] if stage == BASIS else coding["rcq"] if stage == RESIDUAL else
                coding["stages"][stage])

    def codebook(self, layer, c, stage):
        """Rows of a codebook, of a residual codebook, or of a basis."""
        key = (0 if c == SH else layer, c, stage)
        if key not in self.codebooks:
            coding, s = component(self.header, layer, c), self.stage(layer, c, stage)
            dim, n = vector_length(self.header, layer, c), s["num_entries"]
            name = f"{COMPONENTS[c]} codebook" + f" {stage}" * (len(coding["stages"] or ()) > 1)
            name = name if c == SH else f"layer {layer} {name}"
            streams = Streams(self.file, self.file.chunk(s["codebook"], dim * (2 * n + 32)))
            columns = []
            for d in range(dim):
                with located(streams.place()):
                    coded = streams.read(n, 16, f"{name}, number {d}")
                    columns.append(halves(coded, "CODE-4") if s["element"] == 0 else
                                   [f32(s["step"] * f32(unzigzag(v))) for v in coded])
            streams.end("CHNK-7")
            self.codebooks[key] = list(zip(*columns))
        return self.codebooks[key]

    def of_block(self, layer, block):
        """Component -> rows of the codebook that a block has in place of the layer's stage 0."""
        codebooks = {}
        for table in block["tables"]:
            c, n = table["component"], table["num_entries"]
            require(c in (SCALE, ROTOR_SPATIAL, ROTOR_TEMPORAL) and
                    component(self.header, layer, c)["coding"] == VQ and
                    component(self.header, layer, c)["rcq"] is not None, "RCQ-3", f"component {c}")
            require(1 <= n <= 65536, "RCQ-4", "entries")
            require(c not in codebooks, "RCQ-5", "two tables")
            whole, residual = self.codebook(layer, c, 0), self.codebook(layer, c, RESIDUAL)
            streams = Streams(self.file, self.file.chunk(
                table["table"], 2 * (2 * n + 32), self.header["payload_offset"]))
            g = streams.read(n, bit_width(len(whole)), "global", len(whole), "RCQ-1")
            r = streams.read(n, bit_width(len(residual)), "residual", len(residual), "RCQ-1")
            streams.end("CHNK-7")
            codebooks[c] = [[f32(a + b) for a, b in zip(whole[i], residual[j])] for i, j in zip(g, r)]
        return codebooks

    def entropy(self, layer):
        """The tables of the rANS pages of a layer."""
        if layer not in self.entropies:
            channels = page_channels(self.header, layer)
            most = 65794 + sum(contexts for _, contexts in channels)
            chunk = self.file.chunk(self.header["layers"][layer]["entropy"], most)
            self.entropies[layer] = Entropy(self.file, chunk, self.header, channels)
        return self.entropies[layer]


def halves(ordered, clause):
    """The numbers of ordered binary16, which have to be finite."""
    bits = [unorder(v, 16) for v in ordered]
    require(all(b & 0x7FFF < 0x7C00 for b in bits), clause, "a binary16 is not finite")
    return [half(b) for b in bits]

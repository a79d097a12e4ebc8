# SPDX-License-Identifier: Apache-2.0
"""Digests of what a query gives, appendix F of spec/l4d.md: name -> XXH3-64 in hexadecimal digits."""

import struct

from arithmetic import require, unorder
from header import COMPONENTS, F16, VQ, WINDOW
from levels import INDEXED, keeps_profile
from page import ESCAPE, ordered_mean_time
from xxh3 import xxh3_64

ATTRIBUTES = {"position": "f", "mean_t": "f", "mean_t_local": "f", "mean_t_exact": "d",
              "log_scale": "f", "rotor": "f", "opacity": "f", "sh": "f"}
WINDOWS = {"window": "I"}                 # of streams that have them


def little_endian(form, values):
    return struct.pack(f"<{len(values)}{form}", *values)


def has_windows(h):
    return any(la["mean_t"] == WINDOW and la["num_gaussians"] > 0 for la in h["layers"])


class Buckets:
    """F.2: layer, bucket and number of Gaussians of each bucket that pages were selected of."""

    def __init__(self):
        self.rows = []

    def add(self, selected):
        key = [selected.index, selected.record["bucket"]]
        if not self.rows or self.rows[-1][:2] != key:
            self.rows.append([*key, 0])
        self.rows[-1][2] += selected.record["num_gaussians"]

    def count(self):
        return sum(row[2] for row in self.rows)


def finish(arrays, buckets):
    """F.3, of arrays of bytes in the order of their table."""
    arrays["buckets"] = little_endian("Q", [number for row in buckets.rows for number in row])
    digests = {name: xxh3_64(data) for name, data in arrays.items()}
    digests["all"] = xxh3_64(little_endian("Q", [buckets.count(), *digests.values()]))
    return {name: f"{digest:016x}" for name, digest in digests.items()}


def of_attributes(decoder, query):
    forms = {**ATTRIBUTES, **(WINDOWS if has_windows(decoder.header) else {})}
    buckets, arrays = Buckets(), {name: bytearray() for name in forms}
    for selected in decoder.select(query):
        buckets.add(selected)
        page = decoder.attributes(selected, query.base_only)
        page["mean_t_exact"] = page["mean_t_double"]
        page.setdefault("window", [[0, 0]] * len(page["mean_t"]))
        for name, form in forms.items():
            arrays[name] += little_endian(form, [number for row in page[name] for number in row])
    return finish(arrays, buckets)


def of_packed_form(decoder, query):
    require(keeps_profile(decoder.header, INDEXED), "F.2", "not of the profile indexed: no packed form")
    packed, buckets = Packed(decoder), Buckets()
    for selected in decoder.select(query):
        buckets.add(selected)
        packed.add(decoder.page(selected, query.base_only))
    return finish(packed.arrays(), buckets)


class Packed:
    """The integers of pages."""

    def __init__(self, decoder):
        self.decoder = decoder
        self.scalar = {name: [] for name in ("position", "mean_t", "opacity", "scale_factor")}
        self.window = []
        self.depth = [[] for _ in COMPONENTS]
        self.index = [[[] for _ in range(self.most_stages(c))] for c in range(len(COMPONENTS))]
        self.escape = [[] for _ in COMPONENTS]

    def most_stages(self, c):
        layers = range(len(self.decoder.header["layers"]))
        codings = [self.decoder.component(layer, c) for layer in layers]
        return max(len(coding["stages"]) if coding["coding"] == VQ else 0 for coding in codings)

    def add(self, page):
        n, layer = page.n, page.layer
        self.scalar["position"] += [unorder(v, 16) for xyz in zip(*page.position) for v in xyz]
        if layer["mean_t"] == F16:
            shift = int(layer["mean_t_shift"])
            self.scalar["mean_t"] += [unorder(ordered_mean_time(m, shift), 16) for m in page.mean_t]
        else:
            self.scalar["mean_t"] += [0] * n
        self.window += [frame for window in page.window or [(0, 0)] * n for frame in window]
        self.scalar["opacity"] += page.opacity or [0] * n
        self.scalar["scale_factor"] += page.scale_factor or [0] * n
        for c in range(len(COMPONENTS)):
            self.add_component(c, page.component.get(c) or {}, n)

    def add_component(self, c, columns, n):
        """columns: {} where the component is zero, or in an SH chunk that was left out."""
        depth = columns.get("depth", [0] * n)
        self.depth[c] += [255 if d == ESCAPE else d for d in depth]
        for s, row in enumerate(self.index[c]):
            entries = iter(columns["index"][s] if s < len(columns.get("index", ())) else ())
            row += [next(entries) if s < d != ESCAPE else 0 for d in depth]
        for row in zip(*columns.get("escape", ())):
            self.escape[c] += [unorder(v, 16) for v in row]

    def arrays(self):
        out = {name: little_endian("H", values) for name, values in self.scalar.items()}
        if has_windows(self.decoder.header):
            out["window"] = little_endian("I", self.window)
        for c, name in enumerate(COMPONENTS):
            out[f"{name}.depth"] = little_endian("B", self.depth[c])
            out[f"{name}.index"] = b"".join(little_endian("H", row) for row in self.index[c])
        for c, name in enumerate(COMPONENTS):
            out[f"{name}.escape"] = little_endian("H", self.escape[c])
        return out

# SPDX-License-Identifier: Apache-2.0
"""Random legal scenes for stream_builder: codings, layers, blocks and forms of streams in combinations that
no encoder chooses. They keep every rule of the format, those for validators too."""

import random_coding
import random_page
import stream_builder as sb
from arithmetic import half, unorder
from legal import NO_BOUNDS, NoLegalValue, Window, box
from random_coding import component, entries, f32, rotors, scalar
from random_page import F16, FIXED, NONE, RAW32, RAW64, TRANSFORM, VQ, WINDOW, ZERO
from rng import Rng
from times import bucket_bits, tells_frames_apart


class RandomScene:
    """What is not given is drawn.

    may_be_raw  whether any coding may be raw32; layers of others may have rANS pages
    scene       fields of the header; `sh` may be a function of (rng, length of vectors)
    layer       fields of all layers, or a function of the level that returns them; components may be
                functions of (rng, length of vectors, whether it may have block codebooks)
    levels      of the layers, ascending
    sizes       Gaussians of a page, to choose from
    forms       "streams" or "rans": of pages
    buckets     of each layer that has pages, at most so many
    zstd        how likely a chunk is a zstd frame
    loose       no page states when it is visible
    build       of the file: version, flags, unknown_fields, header_last"""

    def __init__(self, seed, may_be_raw=None, scene=None, layer=None, levels=None, sizes=None, forms=None,
                 buckets=5, zstd=None, build=None, loose=False):
        self.rng = rng = Rng(seed)
        given, self.given_layer = scene or {}, layer or {}
        self.sizes = sizes or [1, 2, 3, 7, 8, 9, 16, 31, 32, 33, 65]
        self.forms, self.most_buckets, self.build_options = forms, buckets, build or {}
        self.loose = loose
        self.may_be_raw = rng.random() < 0.4 if may_be_raw is None else may_be_raw
        self.zstd = rng.choice([0, 0, 0.2, 1]) if zstd is None else zstd
        self.scene = self.header(given)
        drawn = given.get("sh")
        dim = 3 * (self.scene["sh_degree"] + 1) ** 2
        self.scene["sh"] = (component(rng, dim, self.may_be_raw) if drawn is None else
                            drawn(rng, dim) if callable(drawn) else drawn)
        most = len(self.scene["sh"]["steps"]) if self.scene["sh"]["coding"] == TRANSFORM else 0
        base = rng.choice([0, 0, most, rng.randint(0, most), rng.randint(0, most)])
        self.scene["sh_base"] = given.get("sh_base", base)
        self.scene["layers"] = [self.layer(level) for level in levels or self.drawn_levels()]
        self.scene["num_gaussians"] = sum(la["num_gaussians"] for la in self.scene["layers"])

    def header(self, given):
        rng = self.rng
        timeline = rng.choice([(30, 1), (60, 1), (24000, 1001), (1, 1), (4294967295, 1001), (1, 7),
                               (4294967295, 4294967291), (1, 4294967295)])
        position = rng.choice([F16, FIXED] + [RAW32] * self.may_be_raw)
        return {
            "time_begin": rng.choice([0.0, -2.5, 12.34, 1e5, -2.0 ** -60]),
            "num_frames": rng.choice([1, 2, 3, 7, 30, 300, 1 << 24]),
            "fps_num": timeline[0], "fps_den": timeline[1], "gate": f32(rng.choice([16.0, 11.08, 0.5])),
            "origin": {k: rng.uniform(-1e7, 1e7) for k in "xyz"},
            "world_scale": rng.uniform(0.1, 10),
            "coordinate_system": rng.choice([0, 1, 2, 99]), "color_space": rng.choice([0, 1, 99]),
            "position_at_mean_time": rng.random() < 0.3, "opacity_logit": rng.random() < 0.3,
            "position": position,
            "position_center": {} if rng.random() < 0.4 else {
                k: f32(rng.choice([0.0, rng.uniform(-9, 9), -2.0 ** 60])) for k in "xyz"},
            "position_scale": f32(rng.choice([1.0, 0.37, 2.0 ** -60, 2.0 ** 60])),
            "position_bits": rng.choice([1, 8, 15, 16, 21, rng.randint(1, 21)]) if position == FIXED else
            rng.randrange(256),
            "opacity": scalar(rng, self.may_be_raw), "sh_degree": rng.choice([0, 0, 1, 2, 3]),
            "metadata": [{"key": "a", "value": "\u00e4"}] * rng.randint(0, 2),
            "errors": rng.choice([None, {}, {"position": 0.5, "covariance": 1.25, "mean_t": 3e38,
                                             "min_size": 1e-3, "own_min_sizes": True}]),
            "rendering": rng.choice([None, {}, {"dilation": 0.1, "compensation": True},
                                     {"cutoff": 3.0, "min_alpha": 0.25, "max_alpha": 0.5}]),
            "presentation": rng.choice([None, {}, {
                "playback": rng.choice([1, 2, 3, 200]), "metres_per_unit": 0.01,
                "bounds": {"min": [-1.0, 0.0, -1e9], "max": [1.0, 0.0, 1e9]},
                "camera": {"position": [0.0, 1.0, 5.0], "target": [0.0, 0.0, 0.0],
                           "up": [0.0, 1.0, 0.0], "fov": 0.9}}]),
            "extensions": [{"id": 70000, "critical": False}] * rng.randint(0, 1), **given}

    def drawn_levels(self):
        """Levels of which the buckets are not too short."""
        rng, most = self.rng, sb.bit_width(self.scene["num_frames"]) + 1
        usable = [lv for lv in range(most) if lv == 0 or Window(self.scene, lv).is_usable()]
        return sorted(rng.choice(usable) for _ in range(rng.randint(1, min(4, 2 * most))))

    def layer(self, level):
        rng = self.rng
        given = self.given_layer(level) if callable(self.given_layer) else self.given_layer
        permanent = given.get("permanent", level == 0 and rng.random() < 0.5)
        layer = self.codings(level, permanent, given)
        buckets = 1 if level == 0 else 2 << level
        least = max(sb.bit_width(buckets) - 11, 0)      # at most 2048 entries in a page table
        bits = layer["directory_bits"] = given.get("directory_bits", min(rng.randint(least, least + 3), 16))
        layer["table_size"] = -(-buckets // (1 << bits))
        layer["blocks"], layer["pages"] = {}, []
        number = min(buckets, rng.randint(0, self.most_buckets))
        used = {rng.choice([0, buckets - 1, rng.randrange(buckets), rng.randrange(buckets)])
                for _ in range(2 * number)}
        for bucket in sorted(used)[:max(number, int(self.forms is not None))]:
            d = bucket >> bits
            if d not in layer["blocks"]:
                layer["blocks"][d] = [self.block(layer) for _ in range(rng.choice([0, 0, 1, 2]))]
            blocks = layer["blocks"][d]
            block = rng.randrange(len(blocks)) if blocks and rng.random() < 0.8 else sb.NO_BLOCK
            for _ in range(rng.choice([1, 1, 2])):
                layer["pages"].append(self.page(layer, bucket, block))
        random_coding.bound_log_scales(layer, Window(self.scene, level))
        if self.forms != "streams" and not self.has_raw(layer) and (
                self.forms == "rans" or rng.random() < 0.8) and layer["pages"]:
            random_page.add_rans_pages(rng, self.scene, layer, all_pages=self.forms == "rans")
        layer["num_gaussians"] = sum(p["num_gaussians"] for p in layer["pages"])
        return layer

    def has_raw(self, layer):
        """RANS-6"""
        position = RAW32 if layer["raw_position"] else self.scene["position"]
        codings = [c["coding"] for c in (self.scene["opacity"], self.scene["sh"], layer["scale_factor"],
                                         layer["scale"], layer["rotor_spatial"], layer["rotor_temporal"])]
        return RAW32 in (*codings, position, layer["mean_t"]) or layer["mean_t"] == RAW64

    def codings(self, level, permanent, given):
        rng, raw = self.rng, self.may_be_raw
        scale = component(rng, 3 if permanent else 4, raw, level > 0, tame=rng.random() < 0.7)
        spatial, temporal = rotors(rng, raw, level > 0)
        width = Window(self.scene, level).width
        may_be_flat = (1 << bucket_bits(level)) <= self.scene["num_frames"] and tells_frames_apart(self.scene)
        layer = {"level": level, "permanent": permanent,
                 "mean_t": NONE if permanent else rng.choice([F16, F16, FIXED, FIXED] +
                                                             [RAW32, RAW64] * raw + [WINDOW] * may_be_flat),
                 **self.window_codes(level),
                 "mean_t_shift": rng.choice([0, rng.randint(0, 10), 10]),
                 "mean_t_bits": rng.choice([1, 16, rng.randint(1, 16)]),
                 "mean_t_zero": rng.choice([0, 65535, rng.randrange(1 << 16)]),
                 "mean_t_step": f32(rng.choice([2.0 ** -60, 2.0 ** 60, rng.uniform(1e-4, 0.1) * width])),
                 "mean_t_fine": rng.random() < 0.5,
                 "log_scale_t": f32(rng.choice([rng.uniform(-3, 9), 2.0 ** 60, -18.0])),
                 "raw_position": raw and rng.random() < 0.3,
                 "scale_factor": scalar(rng, may_be_raw=scale["coding"] == RAW32),
                 "scale": scale, "rotor_spatial": spatial, "rotor_temporal": temporal}
        lengths = {"scale": 3 if permanent else 4, "rotor_spatial": 4, "rotor_temporal": 4}
        for key, value in given.items():
            layer[key] = value(rng, lengths[key], level > 0) if callable(value) else value
        return layer

    def window_codes(self, level):
        """Every bucket has a legal window with them."""
        rng, frames = self.rng, self.scene["num_frames"]
        enough = sb.bit_width(Window(self.scene, level).begins(frames) + 1) if level > 0 else 0
        least = rng.randint(0, 1)
        return {"window_begin_bits": max(rng.choice([0, 1, 9, 17, 24]), enough),
                "window_length_bits": rng.choice([1 - least, 1, 9, 17, 24]), "window_length": least}

    def block(self, layer):
        rng, tables = self.rng, []
        for c, name in enumerate(sb.COMPONENTS, 1):
            if layer[name]["coding"] == VQ and layer[name].get("rcq") and rng.random() < 0.7:
                whole, residual = len(layer[name]["stages"][0]), len(layer[name]["rcq"])
                n = entries(rng)
                pairs = [(rng.randrange(whole), rng.randrange(residual)) for _ in range(n)]
                tables.append((c, n, sb.rcq_table(rng, pairs, whole, residual)))
        return tables

    def page(self, layer, bucket, block):
        rng = self.rng
        n = rng.choice(self.sizes)
        sizes = {} if block == sb.NO_BLOCK else {sb.COMPONENTS[c - 1]: k for c, k, _ in layer[
            "blocks"][bucket >> layer["directory_bits"]][block]}
        window = Window(self.scene, layer["level"], bucket)
        draw = lambda: random_page.Columns(rng, self.scene, layer, n, window, sizes)
        try:
            columns = draw()
        except NoLegalValue:
            columns = self.nearer(layer, window, draw)
        return {"num_gaussians": n, "bucket": bucket, "block": block, **self.visible(layer, window, columns),
                "bounds": self.bounds(layer, columns), "reserved": rng.randrange(256), "columns": columns,
                "raw": columns.streams()}

    def nearer(self, layer, window, draw):
        """Columns with a step of mean times so small that every code lies in the bucket. Pages that the
        layer has had would change their meaning with the step: they are dropped."""
        layer["mean_t_step"] = f32(window.width * 2.0 ** -18)
        layer["mean_t_shift"] = 0
        layer["pages"].clear()
        return draw()

    def visible(self, layer, window, columns):
        rng = self.rng
        if layer["permanent"]:
            first, last = rng.randrange(256), rng.randrange(256)
            first, last = min(first, last), max(first, last)
        elif self.loose or not window.is_usable():
            first, last = 0, 255
        elif layer["level"] == 0:
            first, last = rng.choice([0, 32, 95]), rng.choice([161, 224, 255])
        else:
            first, last = window.visible(rng, columns.shown)
        return {"visible_begin": first, "visible_end": last}

    def bounds(self, layer, columns):
        """A tight box of Gaussians that do not move; for others none is stated."""
        scene = self.scene
        still = layer["rotor_temporal"]["coding"] == ZERO and not any(scene["position_center"].values())
        if layer["raw_position"] or not still or scene["position"] == RAW32 or self.rng.random() < 0.2:
            return NO_BOUNDS
        if scene["position"] == F16:
            return box([[half(unorder(v, 16)) for v in column] for column in columns.position], 1.0)
        return box(columns.position, 2.0 ** max(scene["position_bits"] - 15, 0))

    def build(self):
        rng = self.rng
        options = {"flags": rng.choice([0, 1, 0x82]), "version": (1, rng.randrange(256)),
                   "unknown_fields": rng.random() < 0.5, "header_last": rng.random() < 0.3,
                   **self.build_options}
        return sb.build(self.scene, rng=rng, zstd=self.zstd, **options)

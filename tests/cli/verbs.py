#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Random walks over the verbs of the tool: every verb accepts what every other verb writes.

usage: verbs.py TOOL [--walks N] [--steps N] [--seed N]

A walk begins with a scene of `synth` and applies one verb after the other to what the verbs before
it wrote. Every output must validate. What copies show at an instant must be what their input shows,
bit for bit; what is coded again must show about as many Gaussians as its input, and draw all that its
stated errors allow no doubt of. Works in the current folder. Exit status 1 where something differs; the commands that lead there are printed.
"""

import argparse
import bisect
import json
import math
import random
import struct
import subprocess
import sys

LENGTHS = (1, 3, 20, 60, 600)  # seconds
EFFECTS = ("static", "rigid", "deform", "flicker", "appear", "view")
PRESETS = ("tiny", "small", "default", "large", "archive", "indexed", "indexed-small",
           "indexed-high", "lossless")
# So many more or fewer Gaussians are no difference, besides a share of all.
KEPT_COUNT, KEPT_SHARE = 6, 0.06
# Nothing of a Gaussian is drawn whose opacity is below this; sessions leave it out.
LEAST_OPACITY = 1 / 255


class Failure(Exception):
    pass


def opacities_of(path):
    """Of the rows of a binary PLY of floats whose opacities are logits."""
    with open(path, "rb") as file:
        names = []
        while (line := file.readline().split()) != [b"end_header"]:
            if line[:2] == [b"property", b"float"]:
                names.append(line[2])
            elif line[:1] == [b"property"]:
                raise Failure(f"{path} has a property that is no float")
        rows = struct.iter_unpack(f"<{len(names)}f", file.read())
    return sorted(1 / (1 + math.exp(-row[names.index(b"opacity")])) for row in rows)


def above(opacities, least):
    return len(opacities) - bisect.bisect_left(opacities, least)


class Piece:
    """A file of the walk, from when to when it plays, and the numbers of its media members."""

    def __init__(self, path, begin, end, members=()):
        self.path, self.begin, self.end, self.members = path, begin, end, members

    def instants(self, rng):
        return [self.begin, self.begin + (self.end - self.begin) * rng.uniform(0.02, 0.98)]


class Walk:
    def __init__(self, tool, seed):
        self.tool, self.seed, self.rng = tool, seed, random.Random(seed)
        self.commands, self.files = [], 0

    def run(self, *arguments):
        words = [str(a) for a in arguments]
        self.commands.append(" ".join(["l4dcodec", *words]))
        done = subprocess.run([self.tool, *words, "--json"], capture_output=True, text=True,
                              timeout=300)
        if done.returncode != 0:
            raise Failure(f"exit status {done.returncode}: {(done.stderr or done.stdout)[-800:].strip()}")
        return json.loads(done.stdout)

    def name(self, suffix):
        self.files += 1
        return f"{self.seed}-{self.files}.{suffix}"

    def slice(self, piece, time):
        """(number of Gaussians, digest) at an instant."""
        frame = self.run("slice", piece.path, "--time", repr(time), "--digest")["frames"][0]
        return frame["gaussians"], frame["digests"]["all"]

    def described(self, path):
        """The file as a piece, once it validates."""
        if path.endswith(".l4d"):
            self.run("validate", path)
        about = self.run("info", path)
        media = [m for m in about.get("members") or [] if m["role"] == "media"]
        if media:
            return Piece(path, media[0]["begin"], media[-1]["end"], [m["number"] for m in media])
        shown = about.get("presents") or {}
        begin = shown.get("begin", about["time_begin"])
        end = shown.get("end", about["time_begin"] + about["duration_s"])
        return Piece(path, begin, end)

    def same(self, a, b, times):
        for t in times:
            if self.slice(a, t) != self.slice(b, t):
                raise Failure(f"{a.path} and {b.path} differ at {t}")

    def alike(self, a, b, times):
        """Coding again moves the edges of lifetimes, so an instant on such an edge has a second."""
        for t in times:
            later = t + (a.end - a.begin) / 200
            before, after = self.slice(a, t)[0], self.slice(b, t)[0]
            if abs(before - after) > KEPT_SHARE * before + KEPT_COUNT:
                before, after = self.slice(a, later)[0], self.slice(b, later)[0]
            if abs(before - after) > KEPT_SHARE * before + KEPT_COUNT:
                raise Failure(f"{a.path} shows {before} Gaussians at {t}, {b.path} {after}")

    def opacities(self, piece, time):
        """Of the Gaussians at an instant, in rising order."""
        if self.slice(piece, time)[0] == 0:
            return []
        path = self.name("ply")
        self.run("slice", piece.path, "--time", repr(time), "-o", path)
        return opacities_of(path)

    def opacity_error(self, piece):
        """The largest one that the streams of a file state."""
        error = 0
        for number in piece.members or [None]:
            path = piece.path
            if number is not None:
                path = self.name("l4d")
                self.run("cut", piece.path, "--member", number, "-o", path)
            about = self.run("info", path)
            if about["num_gaussians"] > 0:
                error = max(error, about["stated_errors"]["seen_opacity"])
        return error

    def drawn_alike(self, a, b, times):
        """What is drawn stays, but for those so near to the least opacity that errors decide."""
        error = self.opacity_error(b) + 1e-6
        for t in times:
            before, after = self.opacities(a, t), self.opacities(b, t)
            if (above(after, LEAST_OPACITY) < above(before, LEAST_OPACITY + error) or
                    above(before, LEAST_OPACITY) < above(after, LEAST_OPACITY + error)):
                raise Failure(f"{a.path} and {b.path} draw other Gaussians at {t}, with errors of "
                              f"{error}")

    # ---- verbs: each takes a piece and returns what it wrote, checked ----

    def encode(self, piece, *more):
        path = self.name("l4d")
        self.run("encode", piece.path, "-o", path, *more)
        out = self.described(path)
        times = piece.instants(self.rng)
        self.drawn_alike(piece, out, times)
        if "--live" not in more:  # sessions leave out what is not drawn
            self.alike(piece, out, times)
        return out

    def encode_preset(self, piece):
        return self.encode(piece, "--preset", self.rng.choice(PRESETS))

    def encode_tiers(self, piece):
        return self.encode(piece, "--tiers", "0.4,0.7")

    def encode_live(self, piece):
        segment = max((piece.end - piece.begin) / self.rng.choice((1, 2.5, 4)), 0.2)
        return self.encode(piece, "--live", "--segment", repr(segment))

    def cut(self, piece):
        a, b = sorted(self.rng.uniform(piece.begin, piece.end) for _ in range(2))
        if b - a < 0.05 * (piece.end - piece.begin):
            a, b = piece.begin, (piece.begin + piece.end) / 2
        path = self.name("l4d")
        self.run("cut", piece.path, "--from", repr(a), "--to", repr(b), "-o", path)
        out = self.described(path)
        self.same(piece, out, out.instants(self.rng))
        return out

    def concat(self, piece):
        path = self.name("l4d")
        self.run("concat", piece.path, piece.path, "-o", path)
        out = self.described(path)
        self.same(piece, Piece(path, piece.begin, piece.end), piece.instants(self.rng))
        length = piece.end - piece.begin
        if abs(out.end - out.begin - 2 * length) > 1e-6 * length:
            raise Failure(f"{path} lasts {out.end - out.begin} s, twice {length}")
        return out

    def take_member(self, piece):
        path = self.name("l4d")
        self.run("cut", piece.path, "--member", self.rng.choice(piece.members), "-o", path)
        return self.described(path)

    def remux(self, piece):
        path = self.name("l4d")
        self.run("remux", piece.path, "-o", path)
        out = self.described(path)
        self.same(piece, out, piece.instants(self.rng))
        return out

    def repair(self, piece):
        path = self.name("l4d")
        told = self.run("repair", piece.path, "-o", path)
        if told["dropped"]:
            raise Failure(f"repair drops something of {piece.path}, which is right")
        out = self.described(path)
        self.same(piece, out, piece.instants(self.rng))
        return out

    def decode(self, piece):
        path = self.name("ply")
        self.run("decode", piece.path, "-o", path)
        out = self.described(path)
        self.alike(piece, out, piece.instants(self.rng))
        return out

    def slice_to_file(self, piece):
        """A still scene, unless nothing is visible at the instant."""
        path = self.name("ply")
        time = piece.instants(self.rng)[1]
        if self.slice(piece, time)[0] == 0:
            return piece
        self.run("slice", piece.path, "--time", repr(time), "-o", path)
        return self.described(path)

    def go(self, steps):
        seconds = self.rng.choice(LENGTHS)
        effects = self.rng.sample(EFFECTS, self.rng.randint(1, len(EFFECTS)))
        path = self.name("ply")
        self.run("synth", "--scene", "cloud", "-n", self.rng.randint(1, 900), "--seconds", seconds, "--seed",
                 self.rng.randint(1, 1000), "--effects", ",".join(effects), "-o", path)
        piece = self.encode(self.described(path))
        copies = [self.cut, self.cut, self.concat, self.remux, self.repair, self.slice_to_file]
        codings = [self.encode_preset, self.encode_tiers, self.encode_live]
        for _ in range(steps):
            if not piece.path.endswith(".l4d"):
                verbs = codings
            elif piece.members:  # what takes one stream takes the first of a file, and notes that
                verbs = copies + 2 * [self.take_member]
            else:
                verbs = copies + [self.decode] + codings
            piece = self.rng.choice(verbs)(piece)
            if self.run("info", piece.path)["num_gaussians"] == 0:
                return  # a member of a time in which nothing is visible


def main():
    parser = argparse.ArgumentParser(usage=__doc__)
    parser.add_argument("tool")
    parser.add_argument("--walks", type=int, default=10)
    parser.add_argument("--steps", type=int, default=8)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    commands = failed = 0
    for k in range(options.walks):
        walk = Walk(options.tool, options.seed + k)
        try:
            walk.go(options.steps)
        except Failure as failure:
            failed += 1
            print(f"walk of seed {options.seed + k}: {failure}")
            print("\n".join("  " + c for c in walk.commands if c.split()[1] not in
                            ("validate", "info")))
        commands += len(walk.commands)
    print(f"{options.walks} walks, {commands} commands, {failed} failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())

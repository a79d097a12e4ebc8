#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Plays a stream through a simulated channel and says whether its player has to wait.

  rate.py [OPTIONS] STREAM

  --bytes-per-second R  what the channel delivers (default: R of the level that the stream declares)
  --delay SECONDS       from the first byte to the first picture (default: what reading H and B bytes takes)
  --buffer BYTES        the player pauses reading while it holds so many bytes that it does not need yet
                        (default: B of the level; without a level, no bound)
  --json                one JSON object

The player reads chunks in the order in which they are first needed (section 18.2 of spec/l4d.md), plays forward at
normal speed, and waits at an instant until it has what the instant needs. All numbers are exact. In addition the
program holds the stream against the level that it declares: its player has H + B bytes when it begins, R and B.

Exit status: 0 no wait, and the level holds; 1 otherwise; 2 usage; 3 the stream breaks a rule.
"""

import argparse
import json
import sys
from fractions import Fraction
from pathlib import Path

sys.dont_write_bytecode = True
sys.path.insert(0, str(Path(__file__).resolve().parent / "reference"))

import levels                   # noqa: E402
from arithmetic import Invalid  # noqa: E402
from decoder import Decoder     # noqa: E402


class Playback:
    """What a stream needs: (seconds from its begin, bytes first needed then), the start first."""

    def __init__(self, data):
        decoder = Decoder(data)
        h = self.header = decoder.header
        demand = self.demand = levels.demand(decoder)
        length = Fraction(h["num_frames"] * h["fps_den"], h["fps_num"])
        self.steps = [(Fraction(0), demand.start_bytes)]
        self.steps += [(length * phase / (1 << 40), demand.later[phase]) for phase in sorted(demand.later)]
        self.lossless = levels.keeps_profile(h, levels.LOSSLESS)

    def limits(self):
        """(H, R, B) of the level declared, or None."""
        if self.header["conformance_level"] == 0:
            return None
        _, _, _, start, rate, burst = levels.LEVELS[self.header["conformance_level"]][:6]
        factor = 8 if self.lossless else 1
        return factor * start, factor * rate, factor * burst

    def waits(self, rate, held, buffer):
        """(instant, seconds) of each wait of a player that has `held` bytes when it wants to begin. buffer: None
        where there is no bound."""
        out, got, needed, before = [], Fraction(held), 0, Fraction(0)
        for at, size in self.steps:
            got += rate * (at - before)
            if buffer is not None and before < at:
                got = min(got, needed + buffer)
            needed, before = needed + size, at
            if got < needed:
                out.append((at, (needed - got) / rate))
                got = Fraction(needed)
        return out

    def least_delay(self, rate):
        """Of a player without a bound of its buffer."""
        needed, least = 0, Fraction(0)
        for at, size in self.steps:
            needed += size
            least = max(least, Fraction(needed) / rate - at)
        return least


def play(playback, args):
    limits = playback.limits()
    if limits is None and (args.rate is None or args.delay is None):
        raise ValueError("the stream declares no level: --bytes-per-second and --delay are required")
    start, rate, burst = limits or (0, None, None)
    rate = args.rate or rate
    buffer = burst if args.buffer is None else args.buffer
    delay = Fraction(start + burst) / rate if args.delay is None else args.delay
    held = rate * delay
    if buffer is not None:
        held = min(held, playback.steps[0][1] + buffer)
    waits = playback.waits(rate, held, buffer)
    out = {"bytes_per_second": float(rate), "delay": float(delay), "buffer_bytes": buffer,
           "start_bytes": playback.steps[0][1], "later_bytes": sum(size for _, size in playback.steps[1:]),
           "waits": [{"at": float(at), "seconds": float(seconds)} for at, seconds in waits],
           "least_delay": float(playback.least_delay(rate)), "level": playback.header["conformance_level"],
           "level_holds": None}
    if limits:
        h, r, b = limits
        begins = playback.steps[0][1]
        out["level_holds"] = begins <= h and not playback.waits(r, begins + b, b)
    return out


def show(out):
    buffer = "no bound" if out["buffer_bytes"] is None else f"{out['buffer_bytes']} bytes"
    print(f"channel          {out['bytes_per_second']:.0f} bytes a second, begins after {out['delay']:.3f} s; "
          f"buffer: {buffer}")
    print(f"stream           {out['start_bytes']} bytes at the start, {out['later_bytes']} later")
    print(f"least delay      {out['least_delay']:.3f} s, with a buffer without a bound")
    for wait in out["waits"][:5]:
        print(f"waits            {wait['seconds']:.6f} s, {wait['at']:.6f} s after the beginning")
    print(f"in all           {len(out['waits'])} waits, {sum(w['seconds'] for w in out['waits']):.6f} s")
    holds = {None: "declares no level", True: f"level {out['level']} holds",
             False: f"level {out['level']} is declared and does not hold"}
    print(f"declared         {holds[out['level_holds']]}")


def number(least, most):
    """A type of an argument: a number of this range, as exact as it is written."""
    def parse(text):
        value = Fraction(text)
        if not least <= value <= most:
            raise argparse.ArgumentTypeError(f"is not in {float(least):g}..{most:g}")
        return value
    return parse


def whole(text):
    value = int(text)
    if value < 0:
        raise argparse.ArgumentTypeError("is below 0")
    return value


def main(arguments):
    parser = argparse.ArgumentParser(usage=__doc__)
    parser.add_argument("--bytes-per-second", dest="rate", type=number(Fraction(1, 1000), 10**15))
    parser.add_argument("--delay", type=number(0, 10**9))
    parser.add_argument("--buffer", type=whole)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("stream", type=Path)
    args = parser.parse_args(arguments)
    try:
        out = play(Playback(args.stream.read_bytes()), args)
    except Invalid as broken:
        print(f"rate.py: {broken}", file=sys.stderr)
        return 3
    except (OSError, ValueError) as error:
        print(f"rate.py: {error}", file=sys.stderr)
        return 2
    print(json.dumps(out)) if args.json else show(out)
    return 1 if out["waits"] or out["level_holds"] is False else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""A live loop on one machine: loop.py L4DCODEC [--seconds 60] [--segment 2] [--gaussians N] [--rate R].

A simulated trainer renames pieces of a scene into a folder, each when the time that it covers has
passed. `encode --live` follows the folder, `serve` serves what it writes, and a player here reads the
playlist, fetches what it does not have over HTTP and slices the first instant of each member before it
counts as shown. Prints, as Markdown, from the capture of an instant to its showing: the delay, stalls,
and where the time goes. Exits with 1 if a member did not play.
"""
import argparse
import json
import os
import re
import signal
import struct
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request

POLL = 0.1    # seconds between two looks at the playlist
MARGIN = 0.3  # seconds of the first member that are kept, against jitter


def pieces_of(path, segment, count):
    """PLY files of what becomes visible in each segment."""
    head, body = open(path, "rb").read().split(b"end_header\n", 1)
    head = head.decode()
    names = re.findall(r"property float (\w+)", head)
    row = 4 * len(names)
    time_at, scale_at = (4 * names.index(n) for n in ("t", "scale_3"))
    rows = [[] for _ in range(count)]
    for at in range(0, len(body), row):
        (t,), (s,) = (struct.unpack_from("<f", body, at + o) for o in (time_at, scale_at))
        known = (t - 4 * 2.718281828 ** min(s, 40)) / segment
        rows[int(min(max(known, 0), count - 1))].append(body[at:at + row])
    for k in range(count):
        own = re.sub(r"vertex \d+", f"vertex {len(rows[k])}", head)
        own = re.sub(r"time_begin \S+", f"time_begin {k * segment}", own)
        own = re.sub(r"time_end \S+", f"time_end {(k + 1) * segment}", own)
        yield own.encode() + b"end_header\n" + b"".join(rows[k])


class Player:
    """Fetches members as the playlist lists them, into a file like the one that is served."""

    def __init__(self, tool, url, copy):
        self.tool, self.url, self.copy = tool, url, copy
        self.spans = []   # media members: begin, end, when it could be shown
        self.bytes = 0
        self.have = set()

    def get(self, span=None):
        request = urllib.request.Request(self.url + ("live.m3u8" if span is None else "live.l4d"))
        if span is not None:
            request.add_header("Range", f"bytes={span[0]}-{span[0] + span[1] - 1}")
        with urllib.request.urlopen(request, timeout=10) as answer:
            return answer.read()

    def fetch(self, span):
        if span in self.have:
            return
        data = self.get(span)
        assert len(data) == span[1], "a member that is listed is not whole"
        with open(self.copy, "r+b") as out:
            out.seek(span[0])
            out.write(data)
        self.have.add(span)
        self.bytes += len(data)

    def look(self):
        """Fetches what is new. Whether the list has ended."""
        text = self.get().decode()
        standing = {number: (int(offset), int(size)) for number, size, offset in re.findall(
            r'STANDING:NUMBER=(\d+),.*BYTERANGE="(\d+)@(\d+)"', text)}
        media = re.findall(r'MEMBER:NUMBER=\d+,BEGIN=([^,]+),.*NEEDS="([\d,]*)"\n'
                           r"#EXTINF:([\d.]+),\n#EXT-X-BYTERANGE:(\d+)@(\d+)\n", text)
        for begin, needs, length, size, offset in media[len(self.spans):]:
            for number in filter(None, needs.split(",")):
                self.fetch(standing[number])
            self.fetch((int(offset), int(size)))
            shown = subprocess.run(
                [self.tool, "slice", self.copy, "--time", begin, "--digest", "--json"],
                check=True, stdout=subprocess.PIPE)
            assert json.loads(shown.stdout)["frames"][0]["gaussians"] > 0, "nothing is shown"
            self.spans.append((float(begin), float(begin) + float(length), time.monotonic()))
        return "ENDLIST" in text


def wait_for(path, process):
    while not os.path.exists(path) or os.path.getsize(path) == 0:
        assert process.poll() is None, "the command ended"
        time.sleep(0.02)


def train(folder, pieces, segment, start):
    """Writes pieces in real time."""
    for k, piece in enumerate(pieces):
        hidden = os.path.join(folder, f".{k:05}.ply")
        with open(hidden, "wb") as out:
            out.write(piece)
        time.sleep(max(0, start + (k + 1) * segment - time.monotonic()))
        os.rename(hidden, os.path.join(folder, f"{k:05}.ply"))
    open(os.path.join(folder, "end"), "w").close()


def play(spans, start):
    """Plays members as they could be shown: delay of each, stalls in seconds."""
    clock = spans[0][2] + MARGIN
    delays, stalls = [], []
    for begin, end, ready in spans:
        if ready > clock:
            stalls.append(ready - clock)
            clock = ready
        delays.append(clock - (start + begin))
        clock += end - begin
    return delays, stalls


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("tool")
    parser.add_argument("--seconds", type=float, default=60)
    parser.add_argument("--segment", type=float, default=2)
    parser.add_argument("--gaussians", default="60k")
    parser.add_argument("--rate", default="")
    args = parser.parse_args()
    tool = os.path.abspath(args.tool)
    count = round(args.seconds / args.segment)
    with tempfile.TemporaryDirectory() as work:
        pieces, served = os.path.join(work, "pieces"), os.path.join(work, "served")
        os.mkdir(pieces)
        os.mkdir(served)
        scene = os.path.join(work, "scene.ply")
        subprocess.run([tool, "synth", "--scene", "cloud", "-q", "-n", args.gaussians, "--seconds",
                        str(count * args.segment), "-o", scene], check=True)
        parts = list(pieces_of(scene, args.segment, count))
        processes = []
        try:
            encoder = subprocess.Popen([tool, "encode", "--live", pieces, "--segment", str(args.segment), "-q",
                                        "--playlist", os.path.join(served, "live.m3u8"),
                                        "-o", os.path.join(served, "live.l4d")])
            processes.append(encoder)
            wait_for(os.path.join(served, "live.m3u8"), encoder)
            address = os.path.join(work, "address")
            with open(address, "w") as out:
                command = [tool, "serve", served] + (["--rate", args.rate] if args.rate else [])
                server = subprocess.Popen(command, stdout=out, stderr=subprocess.DEVNULL)
            processes.append(server)
            wait_for(address, server)
            player = Player(tool, open(address).readline().strip(), os.path.join(work, "copy.l4d"))
            open(player.copy, "w").close()
            start = time.monotonic()
            trainer = threading.Thread(target=train, args=(pieces, parts, args.segment, start),
                                       daemon=True)
            trainer.start()
            while not player.look():
                assert encoder.poll() in (None, 0), "the encoder failed"
                time.sleep(POLL)
            trainer.join()
            assert encoder.wait(60) == 0, "the encoder failed"
            live = open(os.path.join(served, "live.l4d"), "rb").read()
            copy = open(player.copy, "rb").read()
            assert live[:len(copy)] == copy, "the player has other bytes"
        finally:
            for process in processes:
                if process.poll() is None:
                    process.send_signal(signal.SIGINT)
                    process.wait()
    delays, stalls = play(player.spans, start)
    ready = [shown - start - end for _, end, shown in player.spans]
    print("| members | of s | MB | ready after capture, mean (max) s | glass to glass, first (last) s | stalls | s |")
    print("|---:|---:|---:|---:|---:|---:|---:|")
    print(f"| {len(delays)} | {args.segment:g} | {player.bytes / 1e6:.2f} | {sum(ready) / len(ready):.2f} "
          f"({max(ready):.2f}) | {delays[0]:.2f} ({delays[-1]:.2f}) | {len(stalls)} | {sum(stalls):.2f} |")
    sys.exit(0 if len(delays) == count else 1)


main()

# SPDX-License-Identifier: Apache-2.0
"""Positions of a stream against other coders of points, at equal precision."""

import itertools
import json
import subprocess

import numpy


def read_positions(path):
    """[n, 3] float32 of the vertices of a binary PLY whose properties are all float."""
    with open(path, "rb") as file:
        names, count = [], 0
        while True:
            line = file.readline().decode("ascii").split()
            if line[:2] == ["element", "vertex"]:
                count = int(line[2])
            elif line[:2] == ["property", "float"]:
                names.append(line[2])
            elif line[:1] == ["end_header"]:
                break
        rows = numpy.frombuffer(file.read(4 * count * len(names)), "<f4").reshape(count, -1)
    return rows[:, [names.index(axis) for axis in "xyz"]].astype(numpy.float64)


def ordered_halves(positions):
    """Binary16 as a stream has them, as integers in the order of their values.

    The frame of a stream is centred on the median of each axis, and scaled by a power of two.
    """
    n = len(positions)
    centre = numpy.partition(positions, n // 2, axis=0)[n // 2]
    offset = positions - centre
    scale = 2.0 ** numpy.ceil(numpy.log2(numpy.abs(offset).max() / 32768))
    bits = (offset / scale).astype(numpy.float16).view(numpy.uint16)
    return numpy.where(bits & 0x8000, ~bits, bits | 0x8000).astype(numpy.uint16)


def morton_codes(points):
    codes = numpy.zeros(len(points), numpy.uint64)
    for bit, axis in itertools.product(range(16), range(3)):
        value = (points[:, axis].astype(numpy.uint64) >> numpy.uint64(bit)) & numpy.uint64(1)
        codes |= value << numpy.uint64(3 * bit + axis)
    return codes


def zigzag(deltas, bits):
    """Differences modulo 2^bits, small for small magnitudes."""
    half = 1 << (bits - 1)
    signed = (deltas.astype(numpy.int64) + half) % (2 * half) - half
    return ((signed << 1) ^ (signed >> 63)).astype(numpy.uint64)


def shuffled(values, bits, by_bit):
    """All lowest bytes (or bits), then all next ones."""
    little = values.astype("<u8").view(numpy.uint8).reshape(-1, 8)[:, :(bits + 7) // 8]
    planes = numpy.ascontiguousarray(little.T)
    if not by_bit:
        return planes.tobytes()
    bits_of_byte = numpy.arange(8, dtype=numpy.uint8)[:, None]
    return b"".join(numpy.packbits(plane[None, :] >> bits_of_byte & 1, axis=1).tobytes()
                    for plane in planes)


def transforms(points, codes):
    """Yields name and bytes of what is handed to a general compressor."""
    for by_bit in (False, True):
        shuffle = "bit shuffle" if by_bit else "byte shuffle"
        axes = [zigzag(numpy.diff(points[:, k].astype(numpy.int64), prepend=0), 16)
                for k in range(3)]
        yield (f"zigzag deltas, {shuffle}",
               b"".join(shuffled(axis, 16, by_bit) for axis in axes))
        yield (f"gaps of Morton codes, {shuffle}",
               shuffled(numpy.diff(codes, prepend=numpy.uint64(0)), 48, by_bit))


def zstd_bytes(data):
    return len(subprocess.run(["zstd", "-19", "-q", "-c"], input=data, capture_output=True,
                              check=True).stdout)


def table(tool, scene, folder, has, skip):
    """Rows of bytes and bits a point. has: names of programs and packages that are there."""
    stream, one, decoded = folder / "means.l4d", folder / "one.l4d", folder / "means.ply"
    # How positions are coded has nothing to do with codebooks, so the least of them do.
    settings = ("--preset", "indexed", "--set", "rans=1", "--codebook", "all=16", "--effort", "1")
    tool("encode", scene, "-o", stream, "-f", *settings)
    tool("encode", scene, "-o", one, "-f", *settings, "--set", "merge-fraction=1")
    sections = tool("info", stream)["sections"]
    tool("decode", stream, "-o", decoded, "-f")
    points = ordered_halves(read_positions(decoded))
    codes = morton_codes(points)
    order = numpy.argsort(codes, kind="stable")
    points, codes = points[order], codes[order]
    rows = [{"name": "l4dcodec, rANS of Morton gaps", "bytes": sections["position"]},
            {"name": "l4dcodec, the same in one layer",
             "bytes": tool("info", one)["sections"]["position"]}]
    raw = folder / "means.bin"
    raw.write_bytes(points.astype("<u2").tobytes())
    rows.append({"name": "none (three binary16)", "bytes": raw.stat().st_size})
    if "zstd" in has:
        sizes = {name: zstd_bytes(data) for name, data in transforms(points, codes)}
        for name, size in sizes.items():
            rows.append({"name": f"zstd -19, {name}", "bytes": size})
    else:
        skip("zstd is not there: no row of it")
    if "packages" in has:
        script = tool.root / "bench" / "peers" / "means.mjs"
        made = subprocess.run(["node", str(script), str(raw), str(folder)], capture_output=True,
                              text=True, check=True)
        for row in json.loads(made.stdout):
            if "skipped" in row:
                skip(f"{row['name']}: {row['skipped']}")
                continue
            rows.append({"name": row["name"], "bytes": row["bytes"]})
            if "file" in row and "zstd" in has:
                with open(row["file"], "rb") as file:
                    rows.append({"name": row["name"] + ", then zstd -19",
                                 "bytes": zstd_bytes(file.read())})
    for row in rows:
        row["bits"] = 8 * row["bytes"] / len(points)
    rows[0]["tables"] = sections.get("entropy_tables", 0)
    return rows

#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Encodes frames as a stream again, and compares that with the stream of the 4D scene they show.

usage: sequences.py L4DCODEC FOLDER [--scene NAME]

Case a: each frame is what `slice` writes, in another order each time, so that no row tells what it
goes on from. Case b: each frame has all Gaussians of the scene, in one order. Case c: each frame is
what `slice` writes, where Gaussians that are not visible are absent. Still: the first of these again
and again, beside it alone. Fidelity is that of renders against the 4D scene at the times of frames,
or against the frame.
Prints a table in Markdown.
"""

import argparse
import json
import os
import pathlib
import subprocess
import sys
import time
import zlib

import numpy

ROOT = pathlib.Path(__file__).resolve().parents[2]
DATA = pathlib.Path(os.environ.get("L4D_DATA_DIR", ROOT.parent / "shared" / "data"))
# Rounds to the fidelity of the stream of the 4D scene.
QUALITIES = (None, 45, 46, 48, 50, 54, 58, 62)


def run(*command):
    """Runs a command: its document, seconds and peak megabytes."""
    begin = time.monotonic()
    with subprocess.Popen([str(c) for c in command] + ["--json"], stdout=subprocess.PIPE,
                          stderr=subprocess.PIPE) as process:
        text = process.stdout.read()
        errors = process.stderr.read()
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        raise RuntimeError(f"{command}: {text.decode()}{errors.decode()}")
    return json.loads(text), time.monotonic() - begin, usage.ru_maxrss / 1024


def arrays_of(path):
    """Arrays and metadata of a file of raw arrays."""
    data = path.read_bytes()
    length = int.from_bytes(data[:8], "little")
    header = json.loads(data[8:8 + length])
    types = {"F32": "<f4", "F64": "<f8", "U32": "<u4", "U64": "<u8"}
    arrays = {}
    for name, entry in header.items():
        if name == "__metadata__":
            continue
        begin, end = (8 + length + x for x in entry["data_offsets"])
        arrays[name] = numpy.frombuffer(data[begin:end], types[entry["dtype"]]).reshape(
            entry["shape"]).astype("f8")
    return arrays, header["__metadata__"]


def rows_of_matrices(rotor):
    """Rotations of space-time [N, 4, 4] of rotors [N, 8]: the polynomials of the specification."""
    s, b01, b02, b12, b03, b13, b23, p = rotor.T
    a = numpy.stack([s + p, b01 - b23, b02 + b13, b12 - b03])
    b = numpy.stack([s - p, b01 + b23, b02 - b13, b12 + b03])
    a, b = a / numpy.linalg.norm(a, axis=0), b / numpy.linalg.norm(b, axis=0)
    s, b01, b02, b12 = (a + b) / 2
    p, b23, b13, b03 = ((a[0] - b[0]) / 2, (b[1] - a[1]) / 2, (a[2] - b[2]) / 2, (b[3] - a[3]) / 2)
    m = numpy.empty((len(rotor), 4, 4))
    signs = numpy.array([[1, -1, -1, 1, -1, 1, 1, -1], [1, -1, 1, -1, 1, -1, 1, -1],
                         [1, 1, -1, -1, 1, 1, -1, -1], [1, 1, 1, 1, -1, -1, -1, -1]])
    squares = numpy.stack([s, b01, b02, b12, b03, b13, b23, p], axis=1) ** 2
    for k in range(4):
        m[:, k, k] = squares @ signs[k]
    m[:, 0, 1] = 2 * (s * b01 - b02 * b12 - b03 * b13 + b23 * p)
    m[:, 1, 0] = -2 * (s * b01 + b02 * b12 + b03 * b13 + b23 * p)
    m[:, 0, 2] = 2 * (s * b02 + b01 * b12 - b03 * b23 - b13 * p)
    m[:, 2, 0] = 2 * (-s * b02 + b01 * b12 - b03 * b23 + b13 * p)
    m[:, 0, 3] = 2 * (s * b03 + b01 * b13 + b02 * b23 + b12 * p)
    m[:, 3, 0] = 2 * (-s * b03 + b01 * b13 + b02 * b23 - b12 * p)
    m[:, 1, 2] = 2 * (s * b12 - b01 * b02 - b13 * b23 + b03 * p)
    m[:, 2, 1] = -2 * (s * b12 + b01 * b02 + b13 * b23 + b03 * p)
    m[:, 1, 3] = 2 * (s * b13 - b01 * b03 + b12 * b23 - b02 * p)
    m[:, 3, 1] = 2 * (-s * b13 - b01 * b03 + b12 * b23 + b02 * p)
    m[:, 2, 3] = 2 * (s * b23 - b02 * b03 - b12 * b13 + b01 * p)
    m[:, 3, 2] = -2 * (s * b23 + b02 * b03 + b12 * b13 + b01 * p)
    return m


def quaternions(axes):
    """w x y z of rotations [N, 3, 3]: of the four formulas the one without cancellation."""
    m = axes
    t = numpy.stack([1 + m[:, 0, 0] + m[:, 1, 1] + m[:, 2, 2], 1 + m[:, 0, 0] - m[:, 1, 1] - m[:, 2, 2],
                     1 - m[:, 0, 0] + m[:, 1, 1] - m[:, 2, 2], 1 - m[:, 0, 0] - m[:, 1, 1] + m[:, 2, 2]])
    x, y, z = m[:, 2, 1] - m[:, 1, 2], m[:, 0, 2] - m[:, 2, 0], m[:, 1, 0] - m[:, 0, 1]
    xy, xz, yz = m[:, 0, 1] + m[:, 1, 0], m[:, 0, 2] + m[:, 2, 0], m[:, 1, 2] + m[:, 2, 1]
    forms = numpy.stack([[t[0], x, y, z], [x, t[1], xy, xz], [y, xy, t[2], yz], [z, xz, yz, t[3]]])
    best = forms[numpy.argmax(t, axis=0), :, numpy.arange(len(m))]
    return best / numpy.linalg.norm(best, axis=1, keepdims=True)


def write_all_frames(tool, scene, folder, frames, fps):
    """Frames in which every Gaussian of the scene has its row."""
    raw = folder / "raw.safetensors"
    lossless = folder / "lossless.l4d"
    run(tool, "encode", scene, "-o", lossless, "--preset", "lossless", "--force")
    run(tool, "decode", lossless, "--format", "raw", "-o", raw, "--force")
    g, metadata = arrays_of(raw)
    rows = rows_of_matrices(g["rotor"]) * numpy.exp(g["log_scale"])[:, None, :]
    time_row = rows[:, 3]
    variance = (time_row ** 2).sum(axis=1)
    velocity = (rows[:, :3] * time_row[:, None]).sum(axis=2) / variance[:, None]
    rest = rows[:, :3] - velocity[:, :, None] * time_row[:, None]
    values, axes = numpy.linalg.eigh(rest @ rest.transpose(0, 2, 1))
    axes[:, :, 2] *= numpy.sign(numpy.linalg.det(axes))[:, None]
    scale = numpy.log(numpy.sqrt(numpy.maximum(values, numpy.maximum(
        values[:, 2:] * 2.0 ** -24, 1e-20))))
    rotation = quaternions(axes)
    mean = g["mean_t_exact"]
    at = mean
    if metadata["position_at"] == "reference_time":
        begin, end = float(metadata["time_begin"]), float(metadata["time_end"])
        at = numpy.clip(mean, begin, end)
    peak = g["opacity"] if metadata["opacity"] == "linear" else 1 / (1 + numpy.exp(-g["opacity"]))
    sh = g["sh"]
    names = (["x", "y", "z"] + [f"f_dc_{k}" for k in range(3)] +
             [f"f_rest_{k}" for k in range(3 * (sh.shape[1] - 1))] + ["opacity"] +
             [f"scale_{k}" for k in range(3)] + [f"rot_{k}" for k in range(4)])
    table = numpy.empty((len(mean), len(names)), "<f4")
    table[:, 3:6] = sh[:, 0]
    table[:, 6:6 + 3 * (sh.shape[1] - 1)] = sh[:, 1:].transpose(0, 2, 1).reshape(len(mean), -1)
    table[:, -7:-4], table[:, -4:] = scale, rotation
    header = "ply\nformat binary_little_endian 1.0\n" + f"element vertex {len(mean)}\n"
    header += "".join(f"property float {n}\n" for n in names) + "end_header\n"
    for k in frames:
        t = k / fps
        opacity = peak * numpy.exp(-(t - mean) ** 2 / (2 * variance))
        opacity = numpy.clip(opacity, 1e-30, 1 - 1e-7)
        table[:, :3] = g["position"] + velocity * (t - at)[:, None]
        table[:, -8] = numpy.log(opacity / (1 - opacity))
        (folder / f"b_{k:04d}.ply").write_bytes(header.encode() + table.tobytes())


def shuffled(source, target, seed):
    """The same frame, its rows in a random order."""
    data = source.read_bytes()
    at = data.index(b"end_header\n") + len(b"end_header\n")
    count = next(int(line.split()[2]) for line in data[:at].decode().splitlines() if line.startswith("element vertex"))
    rows = numpy.frombuffer(data[at:], numpy.uint8).reshape(count, -1)
    target.write_bytes(data[:at] + numpy.random.default_rng(seed).permutation(rows).tobytes())


def write_frames(case, tool, scene, folder, count):
    """The files of a case: [count] paths."""
    for old in folder.glob(f"{case}_*.ply"):
        old.unlink()
    if case == "b":
        write_all_frames(tool, scene, folder, range(count), 30)
    elif case == "c":
        run(tool, "slice", scene, "--from", 0, "--to", count / 30, "--fps", 30, "-o", folder / "c_%04d.ply")
    elif case == "a":
        for k, frame in enumerate(sorted(folder.glob("c_*.ply"))):
            shuffled(frame, folder / f"a_{k:04d}.ply", k)
    else:
        first = (folder / "c_0000.ply").read_bytes()
        for k in range(count):
            (folder / f"still_{k:04d}.ply").write_bytes(first)
    return sorted(folder.glob(f"{case}_*.ply"))


def zipped(paths):
    """Bytes of the files, each compressed as in a ZIP archive."""
    return sum(len(zlib.compress(p.read_bytes(), 6)) for p in paths)


def converted(tool, paths, extension):
    """Megabytes of the frames as files of another format, from ten of them or fewer."""
    some = paths[::-(-len(paths) // 10)]
    total = 0
    for path in some:
        out = path.with_suffix(extension)
        run(tool, "convert", path, out, "--force")
        total += out.stat().st_size
        out.unlink()
    return total / len(some) * len(paths) / 1e6


def archives(tool, paths):
    """The frames in other forms: columns of the table."""
    return (f"{zipped(paths) / 1e6:.1f} | {converted(tool, paths, '.spz'):.0f} | "
            f"{converted(tool, paths, '.sog'):.0f}")


def compared(tool, scene, stream, judges):
    return run(tool, "compare", scene, stream, *judges)[0]["fidelity_db"]


def encoded(tool, scene, source, stream, judges, aim):
    """The first quality at which frames reach the fidelity, or the last."""
    best = None
    for quality in QUALITIES:
        more = () if quality is None else ("--quality", quality)
        _, seconds, memory = run(tool, "encode", source, "--fps", 30, "-o", stream, "--force", *more)
        best = {"bytes": stream.stat().st_size, "seconds": seconds, "memory": memory,
                "quality": quality or "default", "fidelity": compared(tool, scene, stream, judges)}
        if aim is None or best["fidelity"] >= aim - 0.05:
            break
    return best


def row(name, r, against, archive):
    return (f"| {name} | {r['bytes'] / 1e6:.3f} | {r['bytes'] / against:.2f} | {r['fidelity']:.2f} | "
            f"{r['quality']} | {r['seconds']:.0f} | {r['memory']:.0f} | {archive} |")


def scenes(tool, folder):
    basketball = DATA / "basketball" / "basketball.ply"
    if basketball.exists():
        cameras = DATA / "basketball" / "cameras.json"
        yield "basketball", basketball, 150, ("--cameras", cameras, "--ids", "0,10", "--frames", "0:150:50")
    cloud = folder / "cloud.ply"
    run(tool, "synth", "--scene", "cloud", "--effects", "static,deform,rigid", "-n", 20000,
        "--seconds", 2, "--fps", 30, "-o", cloud, "--force")
    yield "synth, deforming", cloud, 60, ("--orbit", 4, "--frames", "0:60:15")


def main(arguments):
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tool")
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--scene", help="only the scene whose name begins so")
    options = parser.parse_args(arguments)
    options.folder.mkdir(parents=True, exist_ok=True)
    print("| scene | MB | of the 4D stream | fidelity, dB | quality | s | peak MB | "
          "ZIP of the frames, MB | SPZ | SOG |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    for name, scene, count, judges in scenes(options.tool, options.folder):
        if options.scene and not name.startswith(options.scene):
            continue
        folder = options.folder
        direct = encoded(options.tool, scene, scene, folder / "direct.l4d", judges, None)
        print(row(f"{name}: the 4D scene", direct, direct["bytes"], "- | - | -"), flush=True)
        for case in ("b", "c", "a"):
            frames = write_frames(case, options.tool, scene, folder, count)
            made = encoded(options.tool, scene, folder / f"{case}_%04d.ply", folder / f"{case}.l4d",
                           judges, direct["fidelity"])
            print(row(f"{name}: frames, case {case}", made, direct["bytes"],
                      archives(options.tool, frames)), flush=True)
        frame, still = folder / "c_0000.ply", folder / "still.l4d"
        alone = encoded(options.tool, frame, frame, still, judges[:-2], None)
        print(row(f"{name}: one frame", alone, alone["bytes"], "- | - | -"), flush=True)
        frames = write_frames("still", options.tool, scene, folder, count)
        made = encoded(options.tool, frame, folder / "still_%04d.ply", still, judges[:-2], alone["fidelity"])
        print(row(f"{name}: it, {count} times", made, alone["bytes"], archives(options.tool, frames)), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

# SPDX-License-Identifier: Apache-2.0
"""Splats as numbers: files of them for formats.py, and how far two readings are from each other."""

import json
import pathlib
import struct
import sys

import numpy

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path += [str(ROOT / "tests" / "cli"), str(ROOT / "tests" / "spec")]
import splats  # noqa: E402  pylint: disable=wrong-import-position
import splats_close  # noqa: E402  pylint: disable=wrong-import-position

COUNT = 300
K0 = splats.basis((0, 0, 1), 0)[0]
NAMES = ("position", "covariance, relative", "opacity", "colour")
DIRECTIONS = numpy.random.default_rng(5).normal(size=(24, 3))
DIRECTIONS /= numpy.linalg.norm(DIRECTIONS, axis=1, keepdims=True)

# The largest differences that the steps of a format, or of a program that keeps bytes, explain. Colours are those in
# DIRECTIONS, with the steps of all harmonics added up.
_STEPS = {"exact": (2e-5, 1e-3, 1e-5, 1e-4),
          "compressed.ply": (0.02, 0.06, 0.003, 0.05),
          "spz": (2e-5, 0.1, 0.003, 0.03),
          "sog": (0.01, 0.1, 0.003, 3),
          "three.js": (2e-5, 1e-3, 0.003, 0.04),
          "Babylon.js": (2e-5, 0.06, 0.005, 0.06),
          # Of a byte of a quaternion it makes 2 b / 255 - 1, and the viewer that the format is from b / 128 - 1.
          "splat, splat-transform": (2e-5, 0.06, 1e-5, 1e-4)}


def steps_of(name):
    return dict(zip(NAMES, _STEPS.get(name, _STEPS["exact"])))


class Splats:
    """position [n, 3], covariance [n, 3, 3], opacity [n] and colour [n, DIRECTIONS, 3] in the world, of numbers that are
    where `world` puts them: scales along axes, and then a rotation."""

    def __init__(self, position, covariance, opacity, sh, world=None):
        world = numpy.eye(4) if world is None else world
        linear = world[:3, :3]
        self.position = position @ linear.T + world[:3, 3]
        self.covariance = linear @ covariance @ linear.T
        self.opacity = opacity
        turn = linear / numpy.linalg.norm(linear, axis=0)
        degree = int(round(sh.shape[1] ** 0.5)) - 1
        # The colour in a direction is that of the direction as it was before the turn.
        basis = numpy.array([splats.basis(d, degree) for d in DIRECTIONS @ turn])
        self.colour = 0.5 + numpy.einsum("dt,ntc->ndc", basis, sh)


def read_ply(path, world=None):
    rows = splats_close.read(str(path))
    rest = sum(name.startswith("f_rest_") for name in rows[0]) // 3
    column = lambda *names: numpy.array([[row[name] for name in names] for row in rows])
    sh = numpy.empty((len(rows), rest + 1, 3))
    for c in range(3):
        sh[:, :, c] = column(f"f_dc_{c}", *(f"f_rest_{rest * c + k}" for k in range(rest)))
    covariance = numpy.array([splats_close.covariance(row) for row in rows]).reshape(-1, 3, 3)
    opacity = 1 / (1 + numpy.exp(-column("opacity")[:, 0]))
    return Splats(column("x", "y", "z"), covariance, opacity, sh, world)


def read_json(path):
    """What loaders/run.mjs writes."""
    found = {key: numpy.array(value, float) for key, value in
             json.loads(path.read_text(encoding="utf-8")).items()}
    if not found:
        return None
    position = found["position"].reshape(-1, 3)
    n = len(position)
    if "covariance" in found:
        six = found["covariance"].reshape(n, 6)
        covariance = six[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(n, 3, 3)
    else:
        scale, rotation = found["scale"].reshape(n, 3), found["rotation"].reshape(n, 4)
        covariance = numpy.array([
            splats_close.covariance({**{f"scale_{k}": numpy.log(s[k]) for k in range(3)},
                                     **{f"rot_{k}": q[k] for k in range(4)}})
            for s, q in zip(scale, rotation)]).reshape(n, 3, 3)
    base = found["dc"] if "dc" in found else (found["base"] - 0.5) / K0
    sh = numpy.concatenate([base.reshape(n, 1, 3), found["sh"].reshape(n, -1, 3)], axis=1)
    world = found["world"].reshape(4, 4).T if "world" in found else None
    return Splats(position, covariance, found["opacity"], sh, world)


def differences(a, b):
    """The largest of each of NAMES, of Gaussians that are nearest to each other."""
    if len(a.position) != len(b.position):
        return dict.fromkeys(NAMES, float("inf"))
    apart = numpy.linalg.norm(a.position[:, None] - b.position[None], axis=2)
    order = apart.argmin(axis=1)
    if len(set(order)) != len(order):
        return dict.fromkeys(NAMES, float("inf"))
    size = numpy.linalg.norm(a.covariance, axis=(1, 2))
    shape = numpy.linalg.norm(a.covariance - b.covariance[order], axis=(1, 2)) / size
    values = (apart.min(axis=1), shape, numpy.abs(a.opacity - b.opacity[order]),
              numpy.abs(a.colour - b.colour[order]))
    return {name: float(value.max()) for name, value in zip(NAMES, values)}


def make_ply(path, degree):
    """A 3DGS PLY of values that no format has to limit."""
    random = numpy.random.default_rng(3)
    rest = 3 * ((degree + 1) ** 2 - 1)
    names = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", *(f"f_rest_{k}" for k in range(rest)), "opacity",
             "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
    rotation = random.normal(size=(COUNT, 4))
    rotation /= numpy.linalg.norm(rotation, axis=1, keepdims=True)
    rows = numpy.concatenate([
        random.uniform(-9, 9, (COUNT, 3)), random.uniform(-1.4, 1.4, (COUNT, 3)),
        random.uniform(-0.6, 0.6, (COUNT, rest)), random.uniform(-3, 3, (COUNT, 1)),
        random.uniform(-5, 0, (COUNT, 3)), rotation], axis=1)
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {COUNT}",
            *(f"property float {name}" for name in names), "end_header", ""]
    path.write_bytes("\n".join(head).encode() + rows.astype("<f4").tobytes())
    return path


def place(raw):
    """Gives a raw file a place, and y down; returns what puts its splats into a world with y up."""
    data = raw.read_bytes()
    size = int.from_bytes(data[:8], "little")
    header = json.loads(data[8:8 + size])
    header["__metadata__"].update({"l4d_origin": "1 -2 3", "l4d_scale": "2",
                                   "l4d_coordinates": "right_down_forward"})
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 8)
    raw.write_bytes(len(text).to_bytes(8, "little") + text + data[8 + size:])
    world = numpy.diag([2.0, -2, -2, 1])
    world[:3, 3] = 1, 2, -3
    return world


def make_splat(path):
    random = numpy.random.default_rng(8)
    path.write_bytes(b"".join(
        numpy.concatenate([random.uniform(-9, 9, 3), random.uniform(0.01, 2, 3)]).astype("<f4").tobytes() +
        random.integers(1, 255, 8, dtype=numpy.uint8).tobytes() for _ in range(COUNT)))
    return path


def state_axes(source, target):
    """An SPZ file that says with an extension that its y is down."""
    data = bytearray(source.read_bytes())
    data[14] |= 2
    data[16:20] = struct.pack("<I", 32 + 12)
    data[32:32] = struct.pack("<III", 0xADBE0003, 4, 6)
    target.write_bytes(data)


def turn_glb(source, target):
    """The splats of a file inside of a node that stretches and turns them, which is in one that moves and turns."""
    data = source.read_bytes()
    size = struct.unpack_from("<I", data, 12)[0]
    document = json.loads(data[20:20 + size])
    document["nodes"] = [
        {"mesh": 0, "rotation": [0.5, 0.5, -0.1, 0.7], "scale": [1.5, 0.5, 1]},
        {"children": [0], "translation": [1, -2, 3], "rotation": [0, 0.6, 0, 0.8]}]
    document["scenes"] = [{"nodes": [1]}]
    q = numpy.array(document["nodes"][0]["rotation"])
    document["nodes"][0]["rotation"] = list(q / numpy.linalg.norm(q))
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    target.write_bytes(struct.pack("<4sIII4s", b"glTF", 2, len(data) - size + len(text), len(text), b"JSON") +
                       text + data[20 + size:])
    return target

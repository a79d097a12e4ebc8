# SPDX-License-Identifier: Apache-2.0
"""Inputs as other programs write them: the tool, the trainer and Python read each in one way, and say the same of it.

The table of docs/inputs.md is what this test finds. To write it again: L4D_WRITE=1 in the environment.
"""

import json
import os
import pathlib
import re
import struct
import subprocess
import warnings
from typing import Any, Dict, List, Optional, Sequence, Tuple

import numpy as np
import pytest
from conftest import TOOL

import l4dcodec as l4d

TRAINER = pathlib.Path(TOOL).parent / "l4dtrain"
TABLE = pathlib.Path(os.environ["L4D_SOURCE"]) / "docs" / "inputs.md"

STATIC = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "rot_0", "rot_1", "rot_2", "rot_3", "scale_0", "scale_1",
          "scale_2", "opacity"]
ROW = [2.0078, 0.08, 1.33, 1.1, 0.76, 0.07, 1.03, -0.2, -0.1, -0.01, -3.9, -5.7, -4.8, 0.85]
ZEROS = [0.0] * len(ROW)
CODES = {"float": "f", "double": "d", "ushort": "e", "uchar": "B"}


def ply(columns: Sequence[str], rows: Sequence[Sequence[float]], types: Optional[Dict[str, str]] = None, *,
        order: str = "<", before: str = "", after: str = "") -> bytes:
    """A binary PLY. Columns of `ushort` get the bits of binary16."""
    kinds = [(types or {}).get(name, "float") for name in columns]
    header = f"ply\nformat binary_{'little' if order == '<' else 'big'}_endian 1.0\n{before}element vertex {len(rows)}\n"
    header += "".join(f"property {kind} {name}\n" for kind, name in zip(kinds, columns)) + f"{after}end_header\n"
    pack = struct.Struct(order + "".join(CODES[kind] for kind in kinds)).pack
    return header.encode() + b"".join(
        pack(*[int(x) if kind == "uchar" else x for kind, x in zip(kinds, row)]) for row in rows)


def text_ply(rows: Sequence[Sequence[float]]) -> bytes:
    header = f"ply\nformat ascii 1.0\nelement vertex {len(rows)}\n" + "".join(f"property float {c}\n" for c in STATIC)
    return (header + "end_header\n" + "".join(" ".join(map(str, row)) + "\n" for row in rows)).encode()


def changed(**values: float) -> List[float]:
    return [values.get(name, x) for name, x in zip(STATIC, ROW)]


def scenes() -> Dict[str, bytes]:
    moving = ["t", "scale_t", "motion_0", "motion_1", "motion_2"]
    quaternions = [f"rot_{k}" for k in range(4, 8)]
    rest = [f"f_rest_{k}" for k in range(72)]
    colors = {3: "red", 4: "green", 5: "blue"}
    activated = changed(opacity=0.7, scale_0=0.02, scale_1=0.003, scale_2=0.008)
    infinite = [changed(opacity=np.inf), changed(opacity=-np.inf), changed(scale_2=-np.inf)]
    stg = ["trbf_center", "trbf_scale", *[f"motion_{k}" for k in range(9)], *[f"omega_{k}" for k in range(4)]]
    return {
        "big-endian": ply(STATIC, [ROW], order=">"),
        "positions of double": ply(STATIC, [changed(x=4e6), changed(x=4e6 + 1)], {n: "double" for n in "xyz"}),
        "binary16 in ushort": ply(STATIC, [ROW], {name: "ushort" for name in STATIC}),
        "rows of zeros": ply(STATIC, [ROW, *[ZEROS] * 9]),
        "quaternion of zeros": ply(STATIC, [changed(rot_0=0, rot_1=0, rot_2=0, rot_3=0)]),
        "infinite logits and scales": ply(STATIC, infinite),
        "activated values": ply(STATIC, [activated]),
        "opacities of 0 to 1 beside logarithms": ply(STATIC, [ROW] * 100),
        "opacities as bytes": ply(STATIC, [changed(opacity=200)], {"opacity": "uchar"}),
        "one row more than stated": ply(STATIC, [ROW, ROW]).replace(b"vertex 2", b"vertex 1"),
        "rows of text with a value too many": text_ply([ROW + [7.0]] * 3),
        "rows of text with a value too few": text_ply([ROW[:-1]] * 3),
        "a misspelt comment": ply(STATIC, [ROW], before="comment l4d_orgin 1 2 3\n"),
        "red, green, blue": ply([colors.get(k, name) for k, name in enumerate(STATIC)],
                                [changed(f_dc_0=207, f_dc_1=182, f_dc_2=132)], {c: "uchar" for c in colors.values()}),
        "harmonics of degree 4": ply(STATIC + rest, [ROW + [0.01] * 72]),
        "t, scale_t, motion": ply(STATIC + moving, [[*ROW, t, -2.3, 0.1, 0, -0.2] for t in (0.25, 0.5)]),
        "t, scale_3, rot_0 to rot_7": ply([*STATIC, "t", "scale_3", *quaternions], [[*ROW, 0.5, -1, 1, 0, 0.1, 0]]),
        "SpacetimeGaussians lite": ply(STATIC + stg, [[*ROW, 0.5, -1, *[0.1] * 9, *[0.0] * 4]]),
        "times of milliseconds": ply(STATIC + stg, [[*ROW, t, -1, *[0.0] * 13] for t in (0, 500)]),
        "times from -0.5 to 0.5": ply([*STATIC, "t", "scale_3", *quaternions],
                                      [[*ROW, t, -4, 1, 0, 0, 0] for t in (-0.5, -0.25, 0.5)]),
        "a lifetime beside t, scale_t": ply([*STATIC, *moving, "lifetime"], [[*ROW, 0.5, -2.3, 0.1, 0, -0.2, 1]]),
        "base colours of 0 to 255": ply(STATIC, [changed(f_dc_0=207, f_dc_1=182, f_dc_2=132)]),
        "two origins": ply(STATIC, [ROW], before="comment l4d_origin 1 2 3\ncomment l4d_origin 4 5 6\n"),
        "a frame rate with a colon": ply(STATIC, [ROW], before="comment fps: 60\n"),
        "unknown columns": ply([*STATIC, "nx", "ny", "nz", "label"], [[*ROW, 0, 0, 0, 7]]),
        "an element behind": ply(STATIC, [ROW], after="element camera 0\nproperty float fx\n"),
        "an unknown column about time": ply([*STATIC, "timestamp"], [[*ROW, 1]]),
        "a lifetime": ply([*STATIC, "lifetime"], [[*ROW, 1]]),
        "velocities without times": ply([*STATIC, "velocity_0", "velocity_1", "velocity_2"], [[*ROW, 1, 0, 0]]),
        "a list among the columns": ply(STATIC, [ROW], after="property list uchar int v\n"),
        "60,000 elements": ply(STATIC, [ROW], before="".join(f"element e{k} 0\n" for k in range(60000))),
    }


def jpeg(width: int, height: int) -> bytes:
    return struct.pack(">HHHHHBHHB", 0xffd8, 0xffe0, 2, 0xffc0, 11, 8, height, width, 1)


def transforms(frames: Sequence[Any] = (), **keys: Any) -> bytes:
    pose = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 0, 1]]
    default: Tuple[Any, ...] = ({"file_path": "images/a.jpg"}, {"file_path": "images/b.jpg"})
    listed = [{"transform_matrix": pose, **frame} for frame in (frames or default)]
    return json.dumps({**keys, "frames": listed}).encode()


def cameras() -> Dict[str, bytes]:
    lens: Any = {"fl_x": 500.0, "fl_y": 500.0}
    return {
        "sizes from JPEGs, focal lengths by frame": transforms(
            [{"file_path": "images/a.jpg", "fl_x": 500}, {"file_path": "images/b.jpg", "fl_x": 700}]),
        "names with dots and without extension": transforms(
            [{"file_path": "./images/r_0.5"}, {"file_path": "images/\u043a 1"}], camera_angle_x=0.8),
        "`is_fisheye`": transforms(**lens, is_fisheye=True),
        "`OPENCV_FISHEYE` with k = 0": transforms(**lens, camera_model="OPENCV_FISHEYE"),
        "`k1` to `k6`": transforms(**lens, k1=0.1, k2=0.01, k3=0.0, k4=0.1, k5=0.01, k6=0.001),
        "`k4` alone": transforms(**lens, camera_model="OPENCV", k4=0.1),
        "`EQUIRECTANGULAR`": transforms(**lens, camera_model="EQUIRECTANGULAR"),
        "`ORTHOPHOTO`": transforms(**lens, camera_model="ORTHOPHOTO"),
        "a model that nobody knows": transforms(**lens, camera_model="SQUIRCLE"),
        "`latlong`": transforms(**lens, latlong=True),
        "`applied_transform`, `ply_file_path`": transforms(**lens, applied_transform=[[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0]],
                                                          ply_file_path="sparse_pc.ply"),
        "lists of images that no frame has": transforms(
            **lens, train_filenames=["./images/a.jpg"], test_filenames=["b.jpg"]),
        "no size": transforms([{"file_path": "images/none.png"}], **lens),
        "masks": transforms([{"file_path": "images/a.jpg", "mask_path": "a.png"}], **lens),
    }


def told(*arguments: object, program: object = TOOL) -> Tuple[Any, str]:
    """The document of a command and "", or None and why it was refused."""
    run = subprocess.run([str(program), *map(str, arguments), "--json"], capture_output=True, text=True)
    document = json.loads(run.stdout) if run.stdout.startswith("{") else None
    if run.returncode == 0:
        return document, ""
    error = (document or {}).get("error") or run.stderr
    return None, error["message"] if isinstance(error, dict) else str(error)


def plain(message: str, path: pathlib.Path) -> str:
    """Without the path, and what an error calls itself."""
    text = message.strip().split("\n")[0].replace(str(path), path.name)
    return re.sub(rf"^(l4d(codec|train): )?(error: )?([A-Z_]+: )?({re.escape(path.name)}: )*", "", text)


def read_scene(path: pathlib.Path) -> Tuple[List[str], str]:
    """Notes, or why Python refuses it."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return l4d.read(path).notes, ""
    except l4d.Error as error:
        return [], plain(str(error), path)


def read_cameras(path: pathlib.Path) -> Tuple[List[str], str]:
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            l4d.read_cameras(path)
            return [plain(str(w.message), path) for w in caught], ""
    except l4d.Error as error:
        return [], plain(str(error), path)


def row(name: str, how: str, notes: Sequence[str], refusal: str) -> str:
    ordinary = ("The file has no timeline", "Static Gaussians last", "cameras have")
    said = [note for note in notes if not note.startswith(ordinary)]
    return f"| {name} | {'refused' if refusal else how} | {refusal or ' '.join(said) or 'nothing'} |"


def test_scenes_are_read_in_one_way(tmp_path: pathlib.Path) -> None:
    rows = []
    for name, data in scenes().items():
        path = tmp_path / "scene.ply"
        path.write_bytes(data)
        document, refusal = told("info", path)
        notes, refused = read_scene(path)
        refusal = plain(refusal, path)
        assert refusal == refused, name
        if document:
            assert [note for note in document["notes"] if note in notes] == notes, name
        rows.append(row(name, document["source"] if document else "", notes, refusal))
    check_table("scenes", rows)


def test_cameras_are_read_in_one_way(tmp_path: pathlib.Path) -> None:
    rows = []
    (tmp_path / "images").mkdir()
    for image in ("a.jpg", "b.jpg", "r_0.5.jpg", "\u043a 1.jpg"):
        (tmp_path / "images" / image).write_bytes(jpeg(640, 480))
    for name, data in cameras().items():
        path = tmp_path / "transforms.json"
        path.write_bytes(data)
        document, refusal = told("cameras", "--from", path, "-o", tmp_path / "out.json", "--force")
        notes, refused = read_cameras(path)
        refusal = plain(refusal, path)
        assert refusal == refused, name
        if document:
            # The tool has notes on what it writes, too, and keeps distortions.
            kept = [note for note in notes if not note.startswith("Cameras whose lens distorts")]
            assert [note for note in document["notes"] if note in notes] == kept, name
        if TRAINER.exists() and refusal:
            _, trained = told("inspect", tmp_path, program=TRAINER)
            assert plain(trained, path).endswith(refusal), name
        rows.append(row(name, cameras_written(tmp_path) if document else "", notes, refusal))
    check_table("cameras", rows)


def cameras_written(folder: pathlib.Path) -> str:
    count = len(json.loads((folder / "out.json").read_text())["cameras"])
    return f"{count} camera{'s' if count > 1 else ''}"


def check_table(what: str, rows: Sequence[str]) -> None:
    """The table of the document between two comments is this one."""
    text = TABLE.read_text()
    begin, end = f"<!-- {what} -->\n", f"<!-- end of {what} -->"
    head, _, behind = text.partition(begin)
    _, _, tail = behind.partition(end)
    table = "| input | read as | said of it |\n|---|---|---|\n" + "\n".join(rows) + "\n"
    wanted = head + begin + table + end + tail
    if os.environ.get("L4D_WRITE"):
        TABLE.write_text(wanted)
    elif text != wanted:
        pytest.fail(f"docs/inputs.md: the table of {what} is\n{table}")

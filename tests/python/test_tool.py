# SPDX-License-Identifier: Apache-2.0
"""Python gives what the tool gives, byte for byte."""

import dataclasses
import json
import pathlib
import struct
import zlib
from fractions import Fraction
from typing import Any, Dict

import numpy as np
import pytest
from conftest import tool

import l4dcodec as l4d


@pytest.mark.parametrize("preset", ["default", "tiny", "indexed", "lossless"])
def test_encode_writes_the_bytes_of_the_tool(folder: pathlib.Path, tmp_path: pathlib.Path, preset: str) -> None:
    # The package renders no views for importance.
    tool("encode", folder / "scene.ply", "--estimate", "--preset", preset, "-o", tmp_path / "tool.l4d")
    report = l4d.encode(folder / "scene.ply", tmp_path / "python.l4d", preset=preset)
    expected = (tmp_path / "tool.l4d").read_bytes()
    assert (tmp_path / "python.l4d").read_bytes() == expected
    assert report.file_bytes == len(expected)


def test_encode_takes_the_parameters_of_the_tool(folder: pathlib.Path, tmp_path: pathlib.Path) -> None:
    tool("encode", folder / "scene.ply", "--estimate", "--preset", "indexed", "--effort", 3, "--codebook", "sh=256",
         "--stages", "scale=1,0.25", "--tiers", "0.3,0.6", "--seed", 7, "-o", tmp_path / "tool.l4d")
    with open(tmp_path / "python.l4d", "wb") as out:
        l4d.encode(l4d.read(folder / "scene.ply"), out, preset="indexed", seed=7, threads=1,
                   parameters={"effort": 3, "codebook_size.sh": 256, "stages.scale": [1, 0.25], "tiers": [0.3, 0.6]})
    assert (tmp_path / "python.l4d").read_bytes() == (tmp_path / "tool.l4d").read_bytes()
    l4d.encode(folder / "scene.ply", tmp_path / "41.l4d", quality=41)
    tool("encode", folder / "scene.ply", "--estimate", "--quality", 41, "-o", tmp_path / "tool41.l4d")
    assert (tmp_path / "41.l4d").read_bytes() == (tmp_path / "tool41.l4d").read_bytes()


@pytest.mark.parametrize("metric", ["gauss-newton", "sum"])
def test_encode_takes_importance(folder: pathlib.Path, tmp_path: pathlib.Path, metric: str) -> None:
    tool("encode", folder / "scene.ply", "--orbit", 2, "--save-weights", tmp_path / "weights.ply", "--all-views",
         "--metric", metric, "-o", tmp_path / "tool.l4d")
    rows = (tmp_path / "weights.ply").read_bytes()
    header, _, data = rows.partition(b"end_header\n")
    assert f"comment metric {metric}\n".encode() in header
    names = [line.split()[2].decode() for line in header.splitlines() if line.startswith(b"property float")]
    columns = np.frombuffer(data, "<f4").reshape(-1, len(names)).T
    weights = {name.replace("weight_", ""): column for name, column in zip(names, columns)}
    assert set(weights) == set(["sh", "scale", "rotor_spatial", "rotor_temporal", "alpha_t", "position", "opacity",
                                "mean_t"])
    made = tmp_path / "python.l4d"
    l4d.encode(folder / "scene.ply", made, importance=l4d.Importance(weights, metric, "some"))
    assert made.read_bytes() == (tmp_path / "tool.l4d").read_bytes()
    other = "sum" if metric == "gauss-newton" else "gauss-newton"
    l4d.encode(folder / "scene.ply", made, importance=l4d.Importance(weights, other, "some"))
    assert made.read_bytes() != (tmp_path / "tool.l4d").read_bytes()
    sizes = np.full(columns.shape[1], 0.1)
    l4d.encode(folder / "scene.ply", made, importance=l4d.Importance(min_sizes=sizes))
    assert len(made.read_bytes()) < (folder / "scene.l4d").stat().st_size


@pytest.mark.parametrize("time", [0, 0.7, 1.999, 5])
def test_slice_is_that_of_the_tool(folder: pathlib.Path, tmp_path: pathlib.Path, time: float) -> None:
    tool("slice", folder / "scene.l4d", "--time", time, "-o", tmp_path / "tool.ply")
    with l4d.open(folder / "scene.l4d") as stream:
        stream.slice(time).write(tmp_path / "python.ply")
    assert (tmp_path / "python.ply").read_bytes() == (tmp_path / "tool.ply").read_bytes()


@pytest.mark.parametrize("name", ["scene", "lossless"])
@pytest.mark.parametrize("form", ["l4d", "ftgs", "4dgs"])
def test_scenes_are_written_as_by_the_tool(folder: pathlib.Path, tmp_path: pathlib.Path, name: str, form: str) -> None:
    theirs, ours = tmp_path / f"tool.{form}.ply", tmp_path / "python"
    if form == "4dgs":
        theirs = tmp_path / "tool.4dgs"
    tool("decode", folder / f"{name}.l4d", "--format", form, "-o", theirs)
    l4d.read(folder / f"{name}.l4d").write(ours, form)
    assert ours.read_bytes() == theirs.read_bytes()


@pytest.mark.parametrize("extension", [".ply", ".spz", ".sog", ".glb", ".usda"])
def test_instants_are_written_as_by_the_tool(folder: pathlib.Path, tmp_path: pathlib.Path, extension: str) -> None:
    ours, theirs = tmp_path / ("ours" + extension), tmp_path / ("tool" + extension)
    scene = l4d.read(folder / "scene.ply")
    scene.placement = {**scene.placement, "coordinate_system": 2, "origin": (3, 4, 5)}
    scene.write(tmp_path / "placed.l4d")
    try:
        with l4d.open(tmp_path / "placed.l4d") as stream:
            notes = stream.slice(0.7).write(ours)
    except l4d.Error as error:
        assert extension == ".sog" and error.status == l4d.Status.FEATURE_UNSUPPORTED
        pytest.skip("a build without WebP")
    tool("slice", tmp_path / "placed.l4d", "--time", 0.7, "-o", theirs)
    assert ours.read_bytes() == theirs.read_bytes() and "one instant" in notes[0]
    # All of a scene, by its name; a static one needs no time.
    tool("convert", folder / "scene.ply", theirs, "--time", 0.7, "-f")
    l4d.read(folder / "scene.ply").write(ours, time=0.7)
    assert ours.read_bytes() == theirs.read_bytes()
    tool("slice", folder / "scene.l4d", "--time", 0.7, "-o", tmp_path / "frame.ply")
    with pytest.warns(UserWarning):
        static = l4d.read(tmp_path / "frame.ply")
    assert static.is_static and not scene.is_static
    static.write(ours)
    tool("convert", tmp_path / "frame.ply", theirs, "-f")
    assert ours.read_bytes() == theirs.read_bytes()


@pytest.mark.parametrize("time, shown, of_two", [(-5, 0, 0), (99, 2, 4), (0.7, 0.7, 0.7)])
def test_times_outside_of_the_sequence(folder: pathlib.Path, tmp_path: pathlib.Path, time: float, shown: float,
                                       of_two: float) -> None:
    two = tmp_path / "two.l4d"
    tool("concat", folder / "scene.l4d", folder / "scene.l4d", "-o", two)
    with l4d.open(folder / "scene.l4d") as stream, l4d.open(two) as both:
        assert (stream.slice(time).time, both.slice(time).time) == (shown, of_two)
    told = json.loads(tool("convert", folder / "scene.ply", tmp_path / "tool.glb", "--time", time, "--json"))["notes"]
    found = l4d.read(folder / "scene.ply").write(tmp_path / "python.glb", time=time)
    assert found == [note.replace("--time", "`time`") for note in told] and len(found) == 1 + (time != shown)
    assert (tmp_path / "python.glb").read_bytes() == (tmp_path / "tool.glb").read_bytes()


@pytest.mark.parametrize("fps", [30, 29.97, 23.976, 59.94, 12.5, 1 / 3, 0.001, 7.123456789, 1e6, 99.7])
def test_frame_rates_mean_what_they_mean_to_the_tool(folder: pathlib.Path, tmp_path: pathlib.Path, fps: float) -> None:
    l4d.open(folder / "scene.l4d").slice(1).write(tmp_path / "frame.ply")
    expected = l4d.read_frames([tmp_path / "frame.ply"], fps=fps).timeline
    assert l4d.Timeline(1, fps).duration == l4d.Timeline(1, np.float64(fps)).duration == expected.duration
    if abs(fps - 29.97) < 1e-6:
        assert expected.fps == Fraction(30000, 1001)
        assert l4d.Timeline(30, np.float32(fps)).duration == l4d.Timeline(30, fps).duration == 1.001
    # A fraction is taken as it is.
    assert l4d.Timeline(2997, Fraction(2997, 100)).duration == 100


def test_names_say_what_is_written(folder: pathlib.Path, tmp_path: pathlib.Path) -> None:
    scene = l4d.read(folder / "scene.ply")
    for name in ("x.l4d", "x.ply", "x.ftgs.ply", "x.stg.ply", "x.4dgs", "x.safetensors"):
        tool("convert", folder / "scene.ply", tmp_path / ("tool_" + name))
        assert (scene.write(tmp_path / name) == []) == (name not in ("x.4dgs", "x.stg.ply"))
        assert (tmp_path / name).read_bytes() == (tmp_path / ("tool_" + name)).read_bytes(), name
    for name, time, message in (("x.glb", None, "`time` says which"), ("x.obj", 1, "must end in .l4d, .ftgs.ply"),
                                ("x.ftgs.ply", 1, "files of one instant"),
                                ("x.compressed.ply", None, "`time` says which")):
        with pytest.raises(l4d.Error, match=message):
            scene.write(tmp_path / name, time=time)


def test_what_an_import_approximates_is_a_warning(folder: pathlib.Path, tmp_path: pathlib.Path) -> None:
    l4d.open(folder / "scene.l4d").slice(1).write(tmp_path / "frame.ply")
    with pytest.warns(UserWarning, match="frame.ply.*Static Gaussians last"):
        scene = l4d.read(tmp_path / "frame.ply", seconds=3, fps=10)
    assert (scene.timeline.num_frames, scene.source) == (30, "3dgs_ply") and scene.notes
    tool("encode", tmp_path / "frame.ply", "--estimate", "--seconds", 3, "--fps", 10, "-o", tmp_path / "tool.l4d")
    l4d.encode(scene, tmp_path / "python.l4d")
    assert (tmp_path / "python.l4d").read_bytes() == (tmp_path / "tool.l4d").read_bytes()


def test_frames_become_the_scene_of_the_tool(folder: pathlib.Path, tmp_path: pathlib.Path) -> None:
    tool("slice", folder / "scene.l4d", "--from", 0, "--to", 0.5, "--fps", 30, "-o", tmp_path / "f_%02d.ply")
    frames = sorted(tmp_path.glob("f_*.ply"))
    cases: Dict[str, Dict[str, Any]] = {"auto": {}, "none": {}, "content": {"position": 0.5, "color": 0.05}}
    for match, errors in cases.items():
        scene = l4d.read_frames(frames, match=match, **errors)
        assert scene.timeline.num_frames == len(frames) == 15
        l4d.encode(scene, tmp_path / "python.l4d", preset="lossless")
        given = ",".join(f"{name}={value}" for name, value in errors.items())
        tool("encode", *frames, "--fps", 30, "--preset", "lossless", "-f", "-o", tmp_path / "tool.l4d", "--match", match,
             *(("--sequence-error", given) if given else ()))
        assert (tmp_path / "python.l4d").read_bytes() == (tmp_path / "tool.l4d").read_bytes()
    header, rows = frames[3].read_bytes().split(b"end_header\n")
    frames[3].write_bytes(header.replace(b"element", b"comment l4d_orgin 1 2 3\nelement", 1) + b"end_header\n" + rows)
    with pytest.warns(UserWarning, match="In 1 of 15 frames, first in .*f_03.ply"):
        notes = l4d.read_frames(frames).notes
    assert sum("l4d_orgin" in note for note in notes) == 1
    with pytest.raises(l4d.Error, match="match"):
        l4d.read_frames(frames, match="rows")
    with pytest.raises(l4d.Error, match="absent.ply"):
        l4d.read_frames([*frames, tmp_path / "absent.ply"])


def test_raw_arrays_are_read(folder: pathlib.Path, tmp_path: pathlib.Path) -> None:
    tool("decode", folder / "lossless.l4d", "--format", "raw", "-o", tmp_path / "raw.safetensors")
    scene, same = l4d.read(tmp_path / "raw.safetensors"), l4d.read(folder / "lossless.l4d")
    assert scene.source == "raw" and scene.timeline == same.timeline
    for name in ("position", "mean_t", "log_scale", "rotor", "opacity", "sh"):
        assert np.array_equal(getattr(scene, name), getattr(same, name)), name


@pytest.mark.parametrize("times", [np.float32, np.float64])
def test_raw_arrays_come_back(tmp_path: pathlib.Path, times: Any) -> None:
    random = np.random.default_rng(3)
    n = 50
    rotor = np.zeros((n, 8), np.float32)
    rotor[:, 0] = 1
    window = np.zeros((n, 2), np.uint32)
    window[::2] = (3, 9)
    scene = l4d.Scene(
        position=random.normal(size=(n, 3)).astype(np.float32), mean_t=random.uniform(7, 9, n).astype(times),
        log_scale=random.uniform(-6, -1, (n, 4)).astype(np.float32), rotor=rotor,
        opacity=random.uniform(0.1, 0.9, n).astype(np.float32), sh=random.normal(size=(n, 4, 3)).astype(np.float32),
        timeline=l4d.Timeline(48, Fraction(24000, 1001), 7.25), window=window, position_at_mean_time=False,
        placement={"origin": (1, 2, 3), "scale": 0.5, "coordinate_system": 1}, rendering={"dilation": 0.1})
    assert scene.write(tmp_path / "scene.safetensors") == []
    scene.write(tmp_path / "other", "raw")
    assert (tmp_path / "other").read_bytes() == (tmp_path / "scene.safetensors").read_bytes()
    same = l4d.read(tmp_path / "scene.safetensors")
    for name in ("position", "mean_t", "log_scale", "rotor", "opacity", "sh", "window"):
        assert np.array_equal(getattr(scene, name), getattr(same, name)), name
    assert same.mean_t.dtype == times and same.timeline == scene.timeline and same.notes == []
    assert (same.position_at_mean_time, same.opacity_logit) == (False, False)
    assert tuple(same.placement["origin"]) == (1, 2, 3) and same.placement["scale"] == 0.5
    assert same.rendering["dilation"] == pytest.approx(0.1)
    tool("convert", tmp_path / "scene.safetensors", tmp_path / "tool.safetensors")
    assert (tmp_path / "tool.safetensors").read_bytes() == (tmp_path / "scene.safetensors").read_bytes()
    scene.opacity[7] = np.nan
    with pytest.raises(l4d.Error, match="Gaussian 7 has an invalid opacity"):
        scene.write(tmp_path / "scene.safetensors")
    assert (tmp_path / "other").read_bytes() == (tmp_path / "scene.safetensors").read_bytes()


def test_decode_gives_the_arrays_of_the_tool(folder: pathlib.Path, tmp_path: pathlib.Path) -> None:
    tool("decode", folder / "scene.l4d", "--format", "raw", "-o", tmp_path / "raw.safetensors")
    data = (tmp_path / "raw.safetensors").read_bytes()
    size = int.from_bytes(data[:8], "little")
    arrays = {}
    for name, entry in json.loads(data[8:8 + size]).items():
        if name != "__metadata__":
            begin, end = entry["data_offsets"]
            kind = {"F32": "<f4", "F64": "<f8", "U32": "<u4", "U64": "<u8"}[entry["dtype"]]
            arrays[name] = np.frombuffer(data[8 + size:][begin:end], kind).reshape(entry["shape"])
    scene = l4d.open(folder / "scene.l4d").decode()
    arrays["mean_t"] = arrays["mean_t_exact"]
    for name in ("position", "mean_t", "log_scale", "rotor", "opacity", "sh"):
        array = arrays[name]
        assert np.array_equal(getattr(scene, name).view(np.uint8), array.view(np.uint8)), name


def test_compare_gives_the_figures_of_the_tool(folder: pathlib.Path, tmp_path: pathlib.Path) -> None:
    a, b = folder / "scene.ply", folder / "scene.l4d"
    tool("encode", a, "--estimate", "-o", tmp_path / "again.l4d", "--order", tmp_path / "order")
    order = np.fromfile(tmp_path / "order", "<u4")
    assert np.array_equal(order, l4d.encode(a, tmp_path / "python.l4d").order)
    for given in (None, order):
        expected = json.loads(tool("compare", a, b, "--json", *([] if given is None else ["--order", tmp_path / "order"])))
        found = l4d.compare(a, b, order=given)
        assert (found.match, found.matched, found.identical) == (expected["match"], 3000, expected["identical"])
        for name, error in expected.get("attributes", {}).items():
            assert (found.errors[name].max, found.errors[name].rmse) == (error["max"], error["rmse"]), name
        assert bool(found.errors) == (found.match != "unknown") == ("attributes" in expected)
        for name, error in expected.get("seen", {}).items():
            assert name == "min_size" or found.errors[name].p999 == error["p999"], name
        if found.errors:
            assert found.errors["visible_position"].max == expected["visible_position"]["max"]
    assert l4d.compare(l4d.read(a), folder / "lossless.l4d").identical


def read_png(path: pathlib.Path) -> "np.ndarray[Any, Any]":
    """[height, width, 3] bytes of a PNG of 8 bits, RGB."""
    data, at, packed = path.read_bytes(), 8, b""
    while at < len(data):
        size, kind = struct.unpack(">I4s", data[at:at + 8])
        if kind == b"IHDR":
            width, height = struct.unpack(">II", data[at + 8:at + 16])
        packed += data[at + 8:at + 8 + size] if kind == b"IDAT" else b""
        at += size + 12
    rows = np.frombuffer(zlib.decompress(packed), np.uint8).reshape(height, 1 + 3 * width)
    out = np.zeros((height + 1, 3 * width + 3), np.int32)  # with a row above and a pixel to the left
    for y, row in enumerate(rows, start=1):
        for x in range(3, 3 * width + 3):
            left, above, corner = out[y, x - 3], out[y - 1, x], out[y - 1, x - 3]
            paeth = min((abs(above - corner), 0, left), (abs(left - corner), 1, above),
                        (abs(left + above - 2 * corner), 2, corner))[2]
            out[y, x] = (row[x - 2] + (0, left, above, (left + above) // 2, paeth)[row[0]]) % 256
    return out[1:, 3:].reshape(height, width, 3)


def test_render_draws_what_the_tool_draws(folder: pathlib.Path, tmp_path: pathlib.Path) -> None:
    tool("synth", "--scene", "square", "--seconds", 1, "--gaussians", 2000, "--cameras-out", tmp_path / "cameras.json",
         "-o", tmp_path / "square.ply")
    tool("encode", tmp_path / "square.ply", "-o", tmp_path / "square.l4d")
    tool("render", tmp_path / "square.l4d", "--time", 0.5, "--cameras", tmp_path / "cameras.json", "--camera", 0,
         "--scale", 0.25, "-o", tmp_path / "tool.png")
    camera = dict(l4d.read_cameras(tmp_path / "cameras.json"))[0]
    small = dataclasses.replace(camera, width=240, height=135, K=np.diag([0.25, 0.25, 1]) @ camera.K)
    stream = l4d.open(tmp_path / "square.l4d")
    image = stream.render(0.5, small)
    expected = read_png(tmp_path / "tool.png")
    assert image.shape == expected.shape == (135, 240, 3) and image.std() > 0.02
    assert np.abs(255 * image.clip(0, 1) - expected).max() <= 0.51
    assert stream.render(0.5, small, alpha=True)[..., 3].max() <= 1
    # The scene suggests camera 0; the numbers of the suggestion are rounded.
    assert np.abs(stream.render(0.5) - stream.render(0.5, camera)).mean() < 1e-3
    l4d.encode(folder / "scene.ply", tmp_path / "none.l4d", first_view=False)
    with pytest.raises(ValueError, match="suggests no camera"):
        l4d.open(tmp_path / "none.l4d").render(0.5)
    with pytest.raises(l4d.Error, match="camera"):
        stream.render(0.5, dataclasses.replace(camera, viewmat=2 * np.eye(4)[:3]))

# SPDX-License-Identifier: Apache-2.0
"""Arguments of wrong types and values: what is raised names the argument, and no error of Python's inside comes out."""

import dataclasses
import pathlib
from fractions import Fraction
from typing import Any, Callable, Dict, List, Tuple

import numpy as np
import pytest

import l4dcodec as l4d

CAMERA = l4d.Camera.call_on((0, 0, -5), (0, 0, 0), width=8, height=8)
Case = Tuple[str, str, Callable[..., Any], Dict[str, Any]]


def cases(folder: pathlib.Path) -> List[Case]:
    """Kind of the argument, its name, a function, and arguments beside it."""
    ply, stream = folder / "scene.ply", l4d.open(folder / "scene.l4d")
    scene, splats = stream.decode(), stream.slice(1)
    out = folder / "x.l4d"

    def scene_with(**fields: Any) -> Any:
        return l4d.encode(dataclasses.replace(scene, **fields), out)

    def camera_with(**fields: Any) -> Any:
        return stream.render(1, dataclasses.replace(CAMERA, **fields))

    def importance_with(**fields: Any) -> Any:
        return l4d.encode(scene, out, importance=l4d.Importance(**fields))

    def timeline_with(**fields: Any) -> float:
        return dataclasses.replace(scene.timeline, **fields).time_end

    def splats_with(**fields: Any) -> Any:
        return dataclasses.replace(splats, **fields).write(folder / "x.spz")

    opened, read, encoded = {"source": folder / "scene.l4d"}, {"source": ply}, {"scene": scene, "output": out}
    frames, looked, between = {"paths": [ply]}, {"time": 1, "camera": CAMERA}, {"position": (0, 0, -5), "target": (0, 0, 0)}
    point = "name detail, count max_level, count max_tier, number time"
    many: List[Tuple[Callable[..., Any], Dict[str, Any], str]] = [
        (l4d.open, {}, "source source"), (l4d.open, opened, "count threads, count max_memory_bytes, count backend, flag tolerant"),
        (l4d.read, {}, "source source"), (l4d.read, read, "time seconds, time fps, flag activated"),
        (l4d.read_frames, {}, "paths paths"), (l4d.read_frames, frames, "time fps, time position, time color"),
        (l4d.read_frames, frames, "name match, count threads"), (l4d.read_cameras, {}, "path path"),
        (l4d.read_checkpoint, {}, "source source"), (l4d.read_checkpoint, {"source": {}}, "time seconds, time fps"),
        (l4d.encode, {"scene": scene}, "path output"), (l4d.encode, encoded, "count threads, count seed, name preset"),
        (l4d.encode, encoded, "flag first_view, mapping parameters, mapping metadata, object importance, object progress"),
        (importance_with, {}, "name metric, name views, mapping weights, array min_sizes"),
        (scene_with, {}, "array position, array mean_t, array log_scale, array rotor, array opacity, array sh"),
        (scene_with, {}, "array window"),
        (scene_with, {}, "flag position_at_mean_time, flag opacity_logit, object timeline"),
        (scene_with, {}, "mapping placement, mapping rendering, mapping presentation"),
        (timeline_with, {}, "count num_frames, rate fps, number time_begin"), (scene.write, {}, "path path"),
        (scene.write, {"path": folder / "x.ply"}, "name format"), (scene.write, {"path": folder / "x.spz"}, "number time"),
        (splats.write, {}, "path path"), (splats_with, {}, "array means, array opacities, array sh, array covariance"),
        (stream.decode, {}, point + ", array range, flag whole_buckets, object progress"),
        (stream.select, {}, point + ", array range, flag whole_buckets"), (stream.slice, {"time": 1}, point),
        (stream.slice, {"time": 1}, "flag sh, flag axes, flag covariance, flag ids, array camera_position"),
        (stream.frames, {}, "rate fps, number begin, number end, count prefetch"), (stream.render, looked, point),
        (stream.render, looked, "object camera, array background, flag alpha"), (l4d.show, {}, "object stream"),
        (stream.show, {"time": 1}, "size width, size height, object camera, rate fps"), (l4d.validate, {}, "source source"),
        (l4d.validate, {"source": b""}, "count threads, count max_memory_bytes, object progress"),
        (l4d.compare, {"a": ply}, "source b"), (l4d.compare, {"b": ply}, "source a"),
        (l4d.compare, {"a": ply, "b": ply}, "array order, count threads"), (l4d.Camera.suggested, {}, "mapping presentation"),
        (l4d.Camera.call_on, between, "array position, array target, array up, rate fov, size width, size height"),
        (camera_with, {}, "array K, array viewmat, size width, size height, rate near_plane")]
    pairs = [(call, rest, word.split()) for call, rest, words in many for word in words.split(", ")]
    return [(kind, name, call, rest) for call, rest, (kind, name) in pairs]


WRONG: Dict[str, List[Any]] = {
    "path": [None, 1.5, [], {}], "source": [None, 1.5, []], "paths": ["scene.ply", b"x", None, 1.5, [], [None], {}.keys()],
    "count": ["x", 1.5, -1, [], float("nan"), 10**30], "size": ["x", 1.5, 0, None], "flag": [None, "no", 2, [], 1.5],
    "time": ["x", None, -1, float("nan"), [1], 10**400], "rate": ["x", 0, -1, float("nan"), [1], True],
    "number": ["x", float("inf"), [1], True], "name": ["low", 1, [], b"x"], "mapping": [1, "x", ["x"], {1: 2}],
    "object": ["x", 1, []], "array": [0.5, "x", [[1, 2], [3]], ["a"], object()]}


def test_what_is_wrong_is_named(folder: pathlib.Path, tmp_path: pathlib.Path) -> None:
    failures = []
    for kind, name, call, rest in cases(folder):
        for value in WRONG[kind]:
            where = f"{getattr(call, '__qualname__', call)}({name}={value!r})"
            try:
                call(**{**rest, name: value})
            except (TypeError, ValueError) as error:
                if name not in str(error):
                    failures.append(f"{where}: {error!r}")
            except Exception as error:
                failures.append(f"{where}: {error!r}")
            else:
                failures.append(f"{where}: is taken")
    assert not failures, "\n".join(failures)
    assert not list(folder.glob("x.*"))


def test_fields_and_items_are_named(folder: pathlib.Path) -> None:
    scene = l4d.open(folder / "scene.l4d").decode()

    def encode(**arguments: Any) -> Any:
        return l4d.encode(scene, folder / "x.l4d", **arguments)

    def scene_with(**fields: Any) -> Any:
        return l4d.encode(dataclasses.replace(scene, **fields), folder / "x.l4d")

    calls: List[Tuple[Callable[[], Any], str]] = [
        (lambda: scene_with(placement={"scal": 1}), r"`placement` has no field `scal`; it has origin, scale, "),
        (lambda: scene_with(placement={"origin": 1}), r"`placement\.origin` is 1 \(int\); it must be 3 numbers"),
        (lambda: scene_with(placement={"scale": "x"}), r"`placement\.scale` is 'x' \(str\); it must be a number"),
        (lambda: l4d.Timeline(30, 10**30).duration, r"`timeline\.fps` is 10+.*; it must be a number .* at most 1000000"),
        (lambda: l4d.Timeline(30, np.float32(2e6)).duration, r"`timeline\.fps` is 2000000\.0; .* at most 1000000"),
        (lambda: l4d.Timeline(30, Fraction(1, 10**30)).duration, r"`timeline\.fps` is Fraction\(1, .*; .* of at least 1e-09"),
        (lambda: scene_with(rendering={"compensation": -1}), r"`rendering\.compensation` is -1; .* from 0 to 4294967295"),
        (lambda: encode(parameters={"effort": None}), r"`parameters\['effort'\]` is None"),
        (lambda: encode(parameters={"tiers": ["a"]}), r"`parameters\['tiers'\]` is of "),
        (lambda: encode(metadata={"by": 1}), r"`metadata\['by'\]` is 1 \(int\); it must be a string"),
        (lambda: encode(importance=l4d.Importance({"alpha": np.ones(3)})), "`importance.weights` is 'alpha'; .*alpha_t"),
        (lambda: l4d.encode(scene, folder / "x.ply"), r"'.*x\.ply' ends in \.ply, but what is written is \.l4d"),
        (lambda: scene.write(folder / "x.xyz"), r"`path` is '.*x\.xyz'; it must end in \.l4d, .*\.usda"),
        (lambda: l4d.Camera.call_on((0, 0, 1), (0, 0, 1)), "`position` and `target` are one point"),
        (lambda: l4d.Camera.call_on((0, 0, 0), (0, 2, 0)), r"`up` is \(0, 1, 0\)"),
        (lambda: l4d.read_frames([folder / "scene.ply"], colour=1.0), "`colour` is no argument .* color"),
        (lambda: l4d.read_frames([folder / "scene.ply", None]), r"`paths\[1\]` is None"),  # type: ignore[list-item]
        (lambda: l4d.read_checkpoint([{}], seconds=2, fps=30), "`fps` or `seconds`, not both")]
    for call, words in calls:
        with pytest.raises((TypeError, ValueError), match=words):
            call()
    assert not list(folder.glob("x.*"))


def test_what_a_file_has_no_use_for_is_said(folder: pathlib.Path) -> None:
    stream, ply = folder / "scene.l4d", folder / "scene.ply"
    with pytest.warns(UserWarning) as caught:
        scene = l4d.read(stream, seconds=7, fps=12, activated=True)
    said = ["--seconds 7 is not used: the file states a duration in seconds of 2.",
            "--fps 12 is not used: the file states a frame rate of 30.",
            "--activated is not used: it is for PLY files with columns for logits and logarithms, and this is l4d."]
    assert scene.notes == said and len(caught) == 3
    with pytest.warns(UserWarning):
        assert l4d.read(ply, seconds=7).notes == said[:1]
    scene.write(folder / "instant.spz", time=1)
    with pytest.warns(UserWarning):
        notes = l4d.read(folder / "instant.spz", seconds=7, fps=12, activated=True).notes
    assert notes[-1] == said[-1].replace("l4d.", "spz.") and not any("--seconds" in note for note in notes)

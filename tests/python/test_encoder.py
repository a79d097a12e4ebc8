# SPDX-License-Identifier: Apache-2.0
"""Encoding: scenes of arrays, progress, Ctrl-C, and what fails."""

import dataclasses
import gc
import io
import pathlib
import signal
import threading
from fractions import Fraction
from typing import Any, List, Tuple

import numpy as np
import pytest

import l4dcodec as l4d


def scene_of(n: int = 50, degree: int = 1, **fields: Any) -> l4d.Scene:
    random = np.random.default_rng(1)
    rotor = np.zeros((n, 8))
    rotor[:, 0] = 1
    arrays: Any = {"position": random.normal(size=(n, 3)), "mean_t": random.uniform(0, 2, n),
              "log_scale": np.full((n, 4), -2.0), "rotor": rotor, "opacity": random.uniform(0.1, 1, n),
              "sh": random.normal(size=(n, (degree + 1) ** 2, 3)) / 5, "timeline": l4d.Timeline(60)}
    return l4d.Scene(**{**arrays, **fields})


def lossless(scene: l4d.Scene) -> l4d.Decoder:
    out = io.BytesIO()
    l4d.encode(scene, out, preset="lossless")
    return l4d.open(out.getvalue())


def test_what_is_stated_comes_back() -> None:
    scene = scene_of(timeline=l4d.Timeline(100, Fraction(30000, 1001), 10.0), opacity_logit=True,
                     placement={"origin": (1, 2, 3), "scale": 0.5},
                     rendering={"dilation": 0.25}, presentation={"playback": 2})
    stream = lossless(scene)
    assert stream.timeline == scene.timeline and stream.timeline.time_end == 10 + 100 * 1001 / 30000
    assert (stream.info.placement.origin, stream.info.placement.scale) == ((1, 2, 3), 0.5)
    assert (stream.info.rendering.dilation, stream.info.presentation.playback) == (0.25, 2)
    again = stream.decode()
    assert again.opacity_logit and again.position_at_mean_time
    assert l4d.compare(scene, again).identical
    assert again.sh_degree == 1 and repr(again) == "<Scene of 50 Gaussians, SH degree 1, 3.33667 s, from l4d>"
    window = lossless(dataclasses.replace(scene, window=np.tile([3, 9], (50, 1)))).decode().window
    assert again.window is None and window is not None and (window == [3, 9]).all()


def test_a_decoded_scene_can_be_encoded(folder: pathlib.Path) -> None:
    scene = l4d.open(folder / "scene.l4d").decode()
    assert not scene.position_at_mean_time and scene.mean_t.dtype == np.float64
    again = lossless(scene)
    assert l4d.compare(scene, again.decode()).identical
    assert np.allclose(np.sort(again.slice(1).opacities), np.sort(l4d.open(folder / "scene.l4d").slice(1).opacities))


def test_report(folder: pathlib.Path) -> None:
    report = l4d.encode(folder / "scene.ply", folder / "report.l4d", metadata={"by": "ä", "of": ""})
    assert l4d.open(folder / "report.l4d").info.metadata == (("by", "ä"), ("of", ""))
    assert sorted(report.order) == list(range(3000)) and report.ratio > 4
    assert dict(report.steps).keys() >= {"check"} and report.all.coded_gaussians == 3000
    assert repr(report).startswith("<EncodeReport: 3000 Gaussians, ")
    assert list(l4d.presets())[0] == "default"
    quality, tiers = l4d.parameters()["quality"], l4d.parameters()["tiers"]
    assert (quality.max, quality.unit, quality.initial, quality.max_values) == (90, "dB", 44, 1)
    assert tiers.max_values == 7 and l4d.parameters()["rans"].stable == 0


def test_progress_and_what_it_raises(folder: pathlib.Path, tmp_path: pathlib.Path) -> None:
    seen = []
    l4d.encode(folder / "scene.ply", tmp_path / "a.l4d", progress=lambda *now: seen.append(now))
    assert len(seen) > 5 and all(done <= total for done, total, _ in seen) and len({stage for _, _, stage in seen}) > 3

    def stop(done: int, total: int, stage: str) -> None:
        raise ZeroDivisionError(stage)

    with pytest.raises(ZeroDivisionError):
        l4d.encode(folder / "scene.ply", tmp_path / "b.l4d", progress=stop)
    with pytest.raises(ZeroDivisionError):
        l4d.open(folder / "scene.l4d").decode(progress=stop)
    with pytest.raises(ZeroDivisionError):
        l4d.validate(folder / "scene.l4d", progress=stop)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.l4d"]


def test_ctrl_c_cancels(folder: pathlib.Path, tmp_path: pathlib.Path) -> None:
    scene = l4d.read(folder / "scene.ply")

    def press(done: int, total: int, stage: str) -> None:
        signal.raise_signal(signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        l4d.encode(scene, tmp_path / "a.l4d", progress=press)
    timer = threading.Timer(0.02, lambda: signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT))
    with pytest.raises(KeyboardInterrupt):
        timer.start()
        for _ in range(1000):
            l4d.compare(scene, folder / "scene.l4d")
    assert list(tmp_path.iterdir()) == []


def test_ctrl_c_ends_a_write(tmp_path: pathlib.Path) -> None:
    n = 150_000
    scene = scene_of(n, 0, sh=np.zeros((n, 16, 3)))
    for name in ("a.ply", "a.ftgs.ply", "a.4dgs", "a.safetensors"):
        path = tmp_path / name
        path.write_bytes(b"before")
        gc.collect()  # what Ctrl-C interrupts must not be a destructor, which hides it
        timer = threading.Timer(0.02, lambda: signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT))
        with pytest.raises(KeyboardInterrupt):
            timer.start()
            scene.write(path)
            pytest.fail("Ctrl-C was heard too late")
        assert path.read_bytes() == b"before"
    assert len(list(tmp_path.iterdir())) == 4


def test_errors_say_what_is_wrong(tmp_path: pathlib.Path) -> None:
    good = scene_of()
    changes: List[Tuple[Any, str]] = [({"position": good.position[:, :2]}, r"`position` has the shape \[50, 2\].*\[50, 3\]"),
                          ({"sh": np.zeros((50, 5, 3))}, "1, 4, 9 or 16 coefficients"),
                          ({"rotor": good.rotor[:9]}, r"`rotor`.*\[50, 8\]"),
                          ({"position": np.full((50, 3), np.nan)}, "INVALID_SCENE.*Gaussian 0"),
                          ({"timeline": l4d.Timeline(0)}, "INVALID_ARGUMENT"),
                          ({"placement": {"scal": 1}}, "scal")]
    for change, words in changes:
        with pytest.raises((l4d.Error, AttributeError), match=words):
            l4d.encode(dataclasses.replace(good, **change), tmp_path / "a.l4d")
    given: List[Tuple[Any, str]] = [({"preset": "best"}, "best"), ({"parameters": {"speed": 1}}, "`speed` is no parameter"),
                             ({"parameters": {"codebook-size.colour": 1}}, "`colour` is no component"),
                             ({"parameters": {"tiers": 0.5}}, "`tiers` is a list"),
                             ({"parameters": {"rcq": [1, 2]}}, "`rcq` is no list"),
                             ({"quality": 500}, "quality"),
                             ({"importance": l4d.Importance({"sh": [1.0, 2.0]})}, r"`sh` has the shape \[2\], not \[50\]"),
                             ({"importance": l4d.Importance({"alpha": np.ones(50)})}, r"`importance\.weights` is 'alpha'"),
                             ({"importance": l4d.Importance(metric="psnr")}, r"`importance\.metric` is 'psnr'; it must be one of sum, gauss-newton"),
                             ({"importance": l4d.Importance(views="few")}, r"`importance\.views` is 'few'"),
                             ({"importance": l4d.Importance(min_sizes=1.0)}, r"`min_sizes`.*\[\], not \[50\]")]
    for arguments, words in given:
        with pytest.raises(l4d.Error, match=words) as caught:
            l4d.encode(good, tmp_path / "a.l4d", **arguments)
        assert caught.value.status == l4d.Status.INVALID_ARGUMENT
    with pytest.raises(l4d.Error, match="nowhere"):
        l4d.encode(good, tmp_path / "nowhere" / "a.l4d")
    with pytest.raises(l4d.Error, match="`format` is 'obj'; it must be one of l4d, ftgs, stg, 4dgs, raw"):
        good.write(tmp_path / "a.ply", "obj")
    with pytest.raises(l4d.Error, match="by its path"):
        l4d.read(b"ply\nformat ascii 1.0\n")
    assert list(tmp_path.iterdir()) == []


def test_a_file_object_that_fails() -> None:
    class Full(io.BytesIO):
        def write(self, data: Any) -> int:
            raise OSError("full")

    with pytest.raises(l4d.Error) as caught:
        l4d.encode(scene_of(), Full())
    assert caught.value.status == l4d.Status.IO and str(caught.value.__cause__) == "full"


def test_every_status_of_the_library_has_a_name() -> None:
    from l4dcodec.core import lib

    codes = {getattr(lib, name) for name in dir(lib) if name.startswith("L4D_ERR_")}
    assert codes | {0} == {status.value for status in l4d.Status}

# SPDX-License-Identifier: Apache-2.0
"""What Python code hands over is checked before C sees it: arrays, files that take a part, strings, numbers."""

import dataclasses
import io
import pathlib
from typing import Any, BinaryIO, Optional, cast

import numpy as np
import pytest
from conftest import tool
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from test_encoder import lossless, scene_of

import l4dcodec as l4d


class Raw(io.RawIOBase):
    """An unbuffered file that takes at most `most` bytes at once; None: it would block."""

    def __init__(self, most: Optional[int]) -> None:
        super().__init__()
        self.most, self.bytes = most, b""

    def writable(self) -> bool:
        return True

    def write(self, data: Any) -> Optional[int]:
        if self.most is None:
            return None
        self.bytes += bytes(data[:self.most])
        return min(self.most, len(data))


def test_a_file_that_takes_a_part_at_a_time_gets_all() -> None:
    whole, raw = io.BytesIO(), Raw(100)
    report = l4d.encode(scene_of(), whole)
    l4d.encode(scene_of(), cast(BinaryIO, raw))
    assert len(raw.bytes) == report.file_bytes and raw.bytes == whole.getvalue()
    for most in (None, 0):
        with pytest.raises(l4d.Error) as caught:
            l4d.encode(scene_of(), cast(BinaryIO, Raw(most)))
        assert caught.value.status == l4d.Status.IO and f"returned {most}" in str(caught.value.__cause__)


def refused(words: str, call: Any) -> None:
    with pytest.raises(l4d.Error, match=words) as caught:
        call()
    assert caught.value.status == l4d.Status.INVALID_ARGUMENT


def test_windows_have_a_shape_and_are_frames() -> None:
    n = 50
    for window in (np.zeros((2, n)), np.zeros((n, 1)), np.zeros((1, 2)), np.zeros(2 * n)):
        refused("`window` has the shape", lambda w=window: lossless(scene_of(window=w.astype(int))))
    refused("`window` is of float64", lambda: lossless(scene_of(window=np.zeros((n, 2)))))
    refused("`window` is from -1", lambda: lossless(scene_of(window=np.full((n, 2), -1))))


def test_what_is_no_array_of_numbers_is_refused() -> None:
    masked: Any = np.ma
    given = masked.MaskedArray(np.full(50, 0.5), np.arange(50) < 3)
    refused("masked", lambda: lossless(scene_of(opacity=given)))
    refused("complex", lambda: lossless(scene_of(opacity=np.full(50, 0.5 + 0j))))
    refused("object", lambda: lossless(scene_of(opacity=np.full(50, None))))


def test_splats_of_other_lengths_are_not_written(folder: pathlib.Path, tmp_path: pathlib.Path) -> None:
    splats = l4d.open(folder / "scene.l4d").slice(1)
    assert splats.sh is not None and splats.covariance is not None
    for changes in ({"means": splats.means[1:]}, {"sh": splats.sh[:, :3]}, {"sh": splats.sh[:, :, :2]},
                    {"opacities": splats.opacities[:-1]}, {"covariance": splats.covariance[:, :5]}):
        refused("has the shape", lambda c=changes: dataclasses.replace(splats, **c).write(tmp_path / "a.ply"))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("extension", [".ply", ".spz", ".sog", ".glb", ".usda"])
def test_splats_that_cannot_be_are_not_written(folder: pathlib.Path, tmp_path: pathlib.Path, extension: str) -> None:
    splats = l4d.open(folder / "scene.l4d").slice(1)
    wrong = [("means", np.nan, "finite"), ("means", np.inf, "finite"), ("sh", np.nan, "finite"),
             ("covariance", -1, "negative"), ("covariance", np.inf, "finite"), ("opacities", 5, "from 0 to 1"), ("opacities", -0.1, "from 0 to 1"),
             ("opacities", np.nan, "from 0 to 1")]
    for name, value, words in wrong:
        array = getattr(splats, name).copy()
        array[7] = value
        refused(rf"`{name}\[7\]` is .*{words}", lambda: dataclasses.replace(splats, **{name: array}).write(
            tmp_path / f"a{extension}"))
    assert list(tmp_path.iterdir()) == []


def test_vectors_have_three_numbers(folder: pathlib.Path) -> None:
    with l4d.open(folder / "scene.l4d") as stream:
        for wrong in ((1,), (1, 2), (1, 2, 3, 4), ("a", "b", "c")):
            refused("background", lambda w=wrong: stream.render(1, background=w))
            refused("camera_position", lambda w=wrong: stream.slice(1, camera_position=w))
    refused("origin", lambda: lossless(scene_of(placement={"origin": (1, 2)})))


def test_times_and_positions_keep_what_their_type_holds() -> None:
    times = np.linspace(100000, 100001, 50)
    timeline = l4d.Timeline(60, 30, 100000.0)
    for kept in (times.astype(">f8"), times.astype(np.longdouble)):
        assert (np.sort(lossless(scene_of(mean_t=kept, timeline=timeline)).decode().mean_t) == times).all()
    whole = np.full(50, 2**24 + 1, np.int64)
    assert (lossless(scene_of(mean_t=whole, timeline=l4d.Timeline(60, 30, 2.0**24))).decode().mean_t == whole).all()
    # Map coordinates: float32 has steps of half a metre there.
    position = np.array([4e6, 5e6, 100.0]) + np.random.default_rng(1).uniform(-1, 1, (50, 3))
    report_order = io.BytesIO()
    report = l4d.encode(scene_of(position=position), report_order, preset="lossless")
    stream = l4d.open(report_order.getvalue())
    back = stream.decode().position.astype(np.float64) + np.array(stream.info.placement.origin)
    assert np.abs(back - position[report.order]).max() < 1e-6


def test_numbers_and_strings_that_cannot_be(folder: pathlib.Path, tmp_path: pathlib.Path) -> None:
    stream = l4d.open(folder / "scene.l4d")
    for fps in (0, -1, float("nan"), float("inf")):
        refused("`fps` is", lambda f=fps: list(stream.frames(f)))
    refused("NUL", lambda: l4d.open("a\0b"))
    refused("NUL", lambda: l4d.encode(scene_of(), str(tmp_path / "a.l4d\0b")))
    refused("preset", lambda: l4d.encode(scene_of(), tmp_path / "a.l4d", preset="small\0"))
    refused("NUL", lambda: l4d.encode(scene_of(), tmp_path / "a.l4d", metadata={"a": "b\0c"}))

    class Endless:
        def read_at(self, offset: int, size: int) -> bytes:
            return b""

        def size(self) -> int:
            return 2**70

    with pytest.raises(l4d.Error) as caught:
        l4d.open(Endless())
    assert "1180591620717411303424" in str(caught.value.__cause__)


def test_a_callback_does_not_close_what_is_in_use(folder: pathlib.Path, tmp_path: pathlib.Path) -> None:
    two = tmp_path / "two.l4d"
    tool("concat", folder / "scene.l4d", folder / "scene.l4d", "-o", two)

    class Closing:
        """A reader that closes the decoder from its third read on."""

        def __init__(self, path: pathlib.Path) -> None:
            self.data, self.stream = path.read_bytes(), None  # type: bytes, Optional[l4d.Decoder]

        def read_at(self, offset: int, size: int) -> bytes:
            if self.stream is not None:
                self.stream.close()
            return self.data[offset:offset + size]

        def size(self) -> int:
            return len(self.data)

    for path in (two, folder / "scene.l4d"):
        reader = Closing(path)
        reader.stream = l4d.open(reader)
        with pytest.raises(l4d.Error) as caught:
            reader.stream.slice(1)
        assert "in a callback" in str(caught.value.__cause__)
        stream, reader.stream = reader.stream, None
        assert len(stream.slice(1)) > 0


SHAPES = arrays.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=5)
DTYPES = st.one_of(arrays.integer_dtypes(), arrays.unsigned_integer_dtypes(), arrays.floating_dtypes(),
                   arrays.boolean_dtypes(), arrays.complex_number_dtypes(), st.just(np.dtype(object)))


@settings(max_examples=200, deadline=None)
@given(name=st.sampled_from(["position", "mean_t", "log_scale", "rotor", "opacity", "sh", "window"]), data=st.data())
def test_arrays_of_any_shape_and_type_are_taken_or_refused(name: str, data: Any) -> None:
    """Whatever an array is, the scene is coded, or an exception says why not; never foreign memory."""
    dtype, shape = data.draw(DTYPES), data.draw(SHAPES)
    array = data.draw(arrays.arrays(dtype, shape)) if dtype != object else np.full(shape, None)
    for view in (array, array[..., ::-1] if array.ndim else array, array.T):
        scene = scene_of(4, **{name: view})
        try:
            again = lossless(scene).decode()
        except (l4d.Error, TypeError) as error:
            assert str(error)
        else:
            assert len(again) == 4


def test_a_placement_has_a_scale() -> None:
    for scale in (0, -1, float("nan")):
        refused("placement: scale", lambda s=scale: lossless(scene_of(placement={"scale": s})))


def test_ids_of_a_placement_are_known(tmp_path: pathlib.Path) -> None:
    for name, known in (("coordinate_system", "0 .UNKNOWN., 1 .RIGHT_UP_BACK., 2 .RIGHT_DOWN_FORWARD."),
                        ("color_space", "0 .SRGB., 1 .LINEAR_SRGB.")):
        for value in (7, 99, 256):
            words = rf"`placement\.{name}` is {value}; it must be one of {known}"
            refused(words, lambda: lossless(scene_of(placement={name: value})))
            refused(words, lambda: scene_of(placement={name: value}).write(tmp_path / "a.ply"))
        # What others have registered comes back, and what a stream states goes on.
        scene = lossless(scene_of(placement={name: 200})).decode()
        assert scene.placement[name] == 200
        assert lossless(dataclasses.replace(scene, placement=l4d.Record(scene.placement, **{name: 99}))).decode()


def test_cameras_are_pinholes_that_stand_somewhere() -> None:
    K, pose = np.array([[50.0, 0, 32], [0, 50, 24], [0, 0, 1]]), np.eye(4)
    pose[:3, 3] = (1, 2, 3)
    l4d.Camera(64, 48, K, pose).to_c()
    skew, twice, last = K.copy(), 2 * K, pose.copy()
    skew[0, 1], last[3, 3] = 5, 2
    for words, given in {"K is no matrix": [(skew, pose), (twice, pose)],
                         "no rotation": [(K, np.zeros((4, 4)))],
                         "0 0 0 1": [(K, pose.T), (K, last)]}.items():
        for matrix, view in given:
            with pytest.raises(ValueError, match=words):
                l4d.Camera(64, 48, matrix, view).to_c()


def test_files_of_other_programs_are_named(tmp_path: pathlib.Path) -> None:
    (tmp_path / "a.ply").write_bytes(b"<!DOCTYPE html><html></html>")
    with pytest.raises(l4d.Error, match="a web page") as caught:
        l4d.read(tmp_path / "a.ply")
    assert caught.value.status == l4d.Status.FEATURE_UNSUPPORTED

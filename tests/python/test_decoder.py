# SPDX-License-Identifier: Apache-2.0
"""Streams: where their bytes come from, queries, threads, memory, and what fails."""

import concurrent.futures
import gc
import io
import mmap
import os
import pathlib
from typing import Any, Callable, List, Optional, Tuple

import numpy as np
import pytest
from conftest import tool
from hypothesis import given, settings
from hypothesis import strategies as st

import l4dcodec as l4d


class Remote:
    """A reader that counts, and fails where it is told to."""

    def __init__(self, data: bytes, error: Optional[BaseException] = None, after: int = 0) -> None:
        self.data, self.error, self.after = data, error, after
        self.reads: List[Tuple[int, int]] = []

    def read_at(self, offset: int, size: int) -> bytes:
        self.reads.append((offset, size))
        if self.error is not None and len(self.reads) > self.after:
            raise self.error
        return self.data[offset:offset + size]

    def size(self) -> int:
        return len(self.data)


def same(a: l4d.Splats, b: l4d.Splats) -> bool:
    return all(np.array_equal(getattr(a, n), getattr(b, n)) for n in ("means", "quats", "scales", "opacities", "sh"))


def test_all_sources_give_the_same(folder: pathlib.Path) -> None:
    path = folder / "scene.l4d"
    data = path.read_bytes()
    expected = l4d.open(path).slice(1)
    with open(path, "rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as mapped:
        sources: List[Any] = [str(path), data, bytearray(data), memoryview(data), Remote(data)]
        for source in sources:
            with l4d.open(source) as stream:
                assert same(stream.slice(1), expected)
        with l4d.open(mapped) as stream:
            assert same(stream.slice(1), expected)
        assert l4d.validate(path) == l4d.validate(data) == l4d.validate(Remote(data)) == []
    remote = Remote(data)
    remote.block_bytes = 65536  # type: ignore[attr-defined]
    assert same(l4d.open(remote).slice(1), expected)
    assert (0, min(65536, len(data))) in remote.reads  # the first block at once


def test_opening_reads_headers_only(folder: pathlib.Path) -> None:
    remote = Remote((folder / "scene.l4d").read_bytes())
    info = l4d.open(remote).info
    assert sum(size for _, size in remote.reads) < len(remote.data) / 10
    assert (info.num_gaussians, info.sh_degree, info.file_bytes) == (3000, 3, len(remote.data))
    assert (info.duration, info.timeline.num_frames, info.profile, info.lossless) == (2, 60, "main", False)
    assert sum(layer.num_gaussians for layer in info.layers) == 3000
    assert info.errors.position <= info.errors.position_bound == 0.5
    stream, remote.reads = l4d.open(remote), []
    stream.slice(1, ids=True)
    assert len(remote.reads) == len(set(remote.reads))  # nothing is read twice
    assert info.all.streamable == 1 and info.placement.origin == (0, 0, 0)


def test_slices_have_the_names_and_shapes_of_gsplat(folder: pathlib.Path) -> None:
    stream = l4d.open(folder / "scene.l4d")
    s = stream.slice(1, ids=True, camera_position=(0, 0, -4))
    assert s.quats is not None and s.scales is not None and s.colors is not None and s.ids is not None
    n = len(s)
    assert 0 < n < 3000 and repr(s) == f"<{n} splats at 1 s>"
    assert s.means.shape == (n, 3) and s.colors.shape == (n, 3) and len(np.unique(s.ids)) == n
    assert np.allclose(np.linalg.norm(s.quats, axis=1), 1, atol=1e-5)
    w, x, y, z = s.quats.T.astype(np.float64)
    rotation = np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
                         2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
                         2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=-1).reshape(n, 3, 3)
    covars = np.einsum("nij,nj,nkj->nik", rotation, s.scales.astype(np.float64) ** 2, rotation)
    trace = np.trace(covars, axis1=1, axis2=2)
    assert np.abs(covars - s.covars).max(axis=(1, 2)).max() < 1e-5 * trace.max()
    few = stream.slice(1, sh=False, axes=False, covariance=False)
    assert few.sh is few.quats is few.scales is few.covariance is few.colors is few.ids is None
    with pytest.raises(ValueError, match="without covariances"):
        few.covars
    for array in (s.means, s.quats, s.scales, s.opacities, s.sh, s.covars):
        assert array is not None
        taken = np.from_dlpack(array)
        assert array.flags.c_contiguous and np.shares_memory(taken, array)


def test_arrays_of_a_scene_are_those_of_the_library(folder: pathlib.Path) -> None:
    position = l4d.read(folder / "scene.ply").position
    gc.collect()
    assert not position.flags.owndata and position.flags.writeable
    again = l4d.read(folder / "scene.ply").position
    assert np.array_equal(position, again)


def test_base_colours_and_layers(folder: pathlib.Path) -> None:
    stream = l4d.open(folder / "scene.l4d")
    full, base = stream.slice(1), stream.slice(1, detail="base")
    assert full.sh is not None and base.sh is not None
    assert np.array_equal(full.means, base.means) and not np.array_equal(full.sh, base.sh)
    out = io.BytesIO()
    l4d.encode(folder / "scene.ply", out, parameters={"merge-fraction": 0, "merge-count": 0, "tiers": [0.5]})
    layers = l4d.open(out.getvalue())
    assert len(layers.slice(1, max_tier=0)) < len(layers.slice(1))
    assert any(len(layers.slice(t / 10, max_level=0)) < len(layers.slice(t / 10)) for t in range(20))
    camera = l4d.Camera.call_on((0, 1, -5), (0, 1, 0), width=32, height=32)
    image = stream.render(1, camera)
    assert not np.array_equal(stream.render(1, camera, detail="base"), image)
    assert np.array_equal(stream.render(1, camera), image)
    with pytest.raises(ValueError, match="`detail` is 'all'; it must be one of full, base"):
        stream.slice(1, detail="all")


def test_files_of_several_streams(folder: pathlib.Path, tmp_path: pathlib.Path) -> None:
    scene, two, part, live = folder / "scene.l4d", tmp_path / "two.l4d", tmp_path / "part.l4d", tmp_path / "live.l4d"
    tool("concat", scene, scene, "-o", two)
    tool("cut", two, "--from", 1, "--to", 3, "-o", part)
    tool("encode", folder / "scene.ply", "--live", "-o", live)
    plain = l4d.open(scene)
    camera = l4d.Camera.call_on((0, 1, -5), (0, 1, 0), width=32, height=32)
    for path, begin, end, count in ((two, 0, 4, 6000), (part, 1, 3, 6000), (live, 0, 2, None)):
        sources: List[Any] = [path, Remote(path.read_bytes())]
        for source in sources:
            with l4d.open(source) as stream:
                timeline = stream.timeline
                assert (timeline.time_begin, timeline.time_end) == (begin, end)
                assert count is None or stream.info.num_gaussians == count
                assert stream.info.file_bytes == path.stat().st_size
                for time in (begin - 1, begin, 1.25, 1.9, end - 0.5, end + 1):
                    tool("slice", path, "--time", time, "-o", tmp_path / "tool.ply", "--force")
                    splats = stream.slice(time, ids=True)
                    splats.write(tmp_path / "python.ply")
                    assert (tmp_path / "python.ply").read_bytes() == (tmp_path / "tool.ply").read_bytes()
                if path != live:
                    assert same(stream.slice(2.5), plain.slice(0.5))
                    assert np.array_equal(stream.render(2.5, camera), plain.render(0.5, camera))
                assert len(list(stream.frames(3))) == 3 * (end - begin)
                with pytest.raises(l4d.Error, match="cut --member"):
                    stream.decode()
                assert "closed" not in repr(stream)
            with pytest.raises(ValueError, match="closed"):
                stream.slice(1)


def test_frames_are_slices(folder: pathlib.Path) -> None:
    stream = l4d.open(folder / "scene.l4d")
    for prefetch in (0, 1, 5, 100):
        frames = list(stream.frames(10, begin=0.5, prefetch=prefetch))
        assert [round(f.time, 9) for f in frames] == [round(0.5 + 0.1 * k, 9) for k in range(15)]
        assert all(same(f, stream.slice(f.time)) for f in frames)
    assert len(list(stream.frames(sh=False, axes=False))) == 60
    endless = stream.frames()
    assert len(next(endless)) > 0
    endless.close()  # type: ignore[attr-defined]
    stream.close()
    with pytest.raises(ValueError, match="closed"):
        list(stream.frames())


@settings(max_examples=150, deadline=None)
@given(begin=st.floats(-1, 3), length=st.floats(0, 3), detail=st.sampled_from(["full", "base"]),
       max_level=st.none() | st.integers(0, 20), whole=st.booleans())
def test_a_query_gives_what_it_selects(folder: pathlib.Path, begin: float, length: float, detail: str,
                                       max_level: Optional[int], whole: bool) -> None:
    stream = l4d.open(folder / "scene.l4d")
    query = {"range": (begin, begin + length), "detail": detail, "max_level": max_level, "whole_buckets": whole}
    scene = stream.decode(**query)  # type: ignore[arg-type]
    assert len(scene) == stream.select(**query).num_gaussians  # type: ignore[arg-type]
    every = stream.decode(detail=detail)
    rows = {row.tobytes() for row in np.column_stack([every.position, every.log_scale])}
    assert all(row.tobytes() in rows for row in np.column_stack([scene.position, scene.log_scale]))
    # What is visible at an instant is among what its query gives.
    assert len(stream.slice(begin)) <= stream.select(begin).num_gaussians


def test_threads_share_a_stream(folder: pathlib.Path) -> None:
    stream = l4d.open(folder / "scene.l4d")
    times = [0.05 * k for k in range(40)]
    expected = [stream.slice(t) for t in times]
    other = l4d.open(folder / "scene.l4d", threads=1)
    with concurrent.futures.ThreadPoolExecutor(8) as pool:
        found = list(pool.map(other.slice, times))
        scenes = list(pool.map(lambda _: other.decode(), range(16)))
    assert all(same(a, b) for a, b in zip(expected, found))
    assert all(np.array_equal(s.sh, scenes[0].sh) for s in scenes)


def test_python_runs_while_c_does(folder: pathlib.Path) -> None:
    ticks = 0
    with concurrent.futures.ThreadPoolExecutor(1) as pool:
        work = pool.submit(l4d.encode, folder / "scene.ply", folder / "aside.l4d", threads=1)
        while not work.done():
            ticks += 1
    assert ticks > 1000  # with the lock held there would be some tens, of the steps of the encoder


def resident() -> int:
    return int(pathlib.Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.skipif(not os.path.exists("/proc/self/statm"), reason="counts memory as Linux does")
def test_a_thousand_opens_keep_no_memory(folder: pathlib.Path) -> None:
    data = (folder / "scene.l4d").read_bytes()

    def use(k: int) -> None:
        stream = l4d.open(folder / "scene.l4d" if k % 2 else Remote(data), threads=1)
        stream.slice(1)
        if k % 50 == 0:
            stream.decode()
            l4d.read(folder / "scene.ply").write(folder / "written.ply")
        if k % 3:
            stream.close()

    for k in range(100):
        use(k)
    gc.collect()
    before, files = resident(), len(os.listdir("/proc/self/fd"))
    for k in range(1000):
        use(k)
    gc.collect()
    # A decoder that holds a slice takes a megabyte.
    assert resident() - before < 20 << 20
    assert len(os.listdir("/proc/self/fd")) == files


def test_errors_say_what_is_wrong(folder: pathlib.Path) -> None:
    data = (folder / "scene.l4d").read_bytes()
    wrong: List[Tuple[Any, str, str]] = [(b"", "NOT_L4D", "magic"), (b"x" * 100, "NOT_L4D", "magic"),
                                         (data[:100], "TRUNCATED", "byte"), (folder / "scene.ply", "NOT_L4D", "")]
    for source, status, words in wrong:
        with pytest.raises(l4d.Error, match=words) as caught:
            l4d.open(source)
        assert "L4D_ERR" not in str(caught.value)
        assert caught.value.status.name == status and str(caught.value).startswith(status)
    with pytest.raises(l4d.Error) as caught:
        l4d.open(data, max_memory_bytes=10)
    assert caught.value.status == l4d.Status.LIMIT_EXCEEDED
    opens: List[Any] = [l4d.open, l4d.read, l4d.validate]
    for call in opens:
        with pytest.raises(FileNotFoundError):
            call(folder / "none.l4d")
    with pytest.raises(TypeError, match="`source` is None"):
        l4d.open(None)  # type: ignore[arg-type]
    stream = l4d.open(data)
    with pytest.raises(ValueError, match="exclude"):
        stream.decode(1, range=(0, 1))
    stream.close()
    stream.close()
    assert "closed" in repr(stream)
    calls: List[Callable[[], object]] = [lambda: stream.slice(1), stream.decode, lambda: stream.counters]
    for use in calls:
        with pytest.raises(ValueError, match="closed"):
            use()


def test_damage_is_found_and_left_out(folder: pathlib.Path) -> None:
    data = bytearray((folder / "scene.l4d").read_bytes())
    data[-100] ^= 1
    violations = l4d.validate(data)
    assert [v.clause for v in violations] and violations[0].offset is not None and violations[0].clause in repr(violations)
    with pytest.raises(l4d.Error) as caught:
        l4d.open(data).decode()
    assert caught.value.status == l4d.Status.CHECKSUM
    tolerant = l4d.open(data, tolerant=True)
    scene = tolerant.decode()
    losses = tolerant.losses
    assert losses and losses[0].status == l4d.Status.CHECKSUM
    lost = sum(loss.num_gaussians for loss in losses if not loss.detail_only)
    assert len(scene) == 3000 - lost == len(scene.sh)


def test_a_file_that_ends_early(folder: pathlib.Path, tmp_path: pathlib.Path) -> None:
    data = (folder / "scene.l4d").read_bytes()
    (tmp_path / "part.l4d").write_bytes(data[:-30000])
    sources: List[Any] = [tmp_path / "part.l4d", data[:-30000]]
    for source in sources:
        stream = l4d.open(source)
        assert stream.info.num_gaussians == 3000
        with pytest.raises(l4d.Error) as caught:
            stream.decode()
        assert caught.value.status == l4d.Status.TRUNCATED
        tolerant = l4d.open(source, tolerant=True)
        assert len(tolerant.decode()) <= 3000 and tolerant.losses[0].status == l4d.Status.TRUNCATED


@pytest.mark.parametrize("error", [OSError("no link"), KeyboardInterrupt()])
def test_a_reader_that_fails(folder: pathlib.Path, error: BaseException) -> None:
    data = (folder / "scene.l4d").read_bytes()
    kind: Any = KeyboardInterrupt if isinstance(error, KeyboardInterrupt) else l4d.Error
    with pytest.raises(kind) as caught:
        l4d.open(Remote(data, error))
    assert caught.value is error or caught.value.__cause__ is error
    remote = Remote(data, error, after=12)
    stream = l4d.open(remote)
    with pytest.raises(kind):
        stream.decode()
    tolerant = l4d.open(Remote(data, error, after=12), tolerant=True)
    if kind is KeyboardInterrupt:
        with pytest.raises(kind):
            tolerant.decode()
    else:
        assert len(tolerant.decode()) < 3000 and tolerant.losses[0].status == l4d.Status.IO
    remote.error = None
    assert len(stream.decode()) == 3000  # the stream stays open


@pytest.mark.parametrize("answer", [b"", b"12", b"x" * 10**6, "text", None, 7])
def test_a_reader_that_answers_nonsense(answer: object) -> None:
    class Nonsense:
        def read_at(self, offset: int, size: int) -> object:
            return answer

        def size(self) -> object:
            return 10**5

    with pytest.raises(l4d.Error):
        l4d.open(Nonsense())  # type: ignore[arg-type]
    try:
        assert l4d.validate(Nonsense())  # type: ignore[arg-type]
    except l4d.Error as error:
        assert error.status == l4d.Status.IO


def test_a_reader_cannot_use_the_stream_that_reads(folder: pathlib.Path) -> None:
    class Again(Remote):
        stream: Optional[l4d.Decoder] = None
        status: Optional[l4d.Status] = None

        def read_at(self, offset: int, size: int) -> bytes:
            if self.stream is not None:
                with pytest.raises(l4d.Error) as caught:
                    self.stream.slice(1)
                self.status = caught.value.status
            return super().read_at(offset, size)

    reader = Again((folder / "scene.l4d").read_bytes())
    reader.stream = l4d.open(reader)
    assert len(reader.stream.slice(1)) > 0
    assert reader.status == l4d.Status.INVALID_STATE

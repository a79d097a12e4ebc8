# SPDX-License-Identifier: Apache-2.0
"""Streams: what they contain, their Gaussians, their splats at an instant, and images of them."""

import concurrent.futures
import contextlib
import dataclasses
import math
import os
import threading
from collections import deque
from types import TracebackType
from typing import TYPE_CHECKING, Any, Dict, Iterator, List, Optional, Sequence, Tuple, Type, Union

import numpy as np

from . import arguments as given
from .camera import Camera
from .core import (Call, Error, Floats, Progress, Reader, Record, Source, Status, c_reader, check, ffi, floats,
                   lib, path_bytes, pointer, reader_of, record, struct, text)
from .scene import ATTRIBUTES, Scene, Splats, Timeline, flags_of, shape_of

if TYPE_CHECKING:
    from .notebook import Shown

DETAIL = {"full": 0, "base": 1}
ID = np.dtype([("layer", "<u4"), ("bucket", "<u4"), ("index", "<u8")])


@dataclasses.dataclass(frozen=True)
class Info:
    """What the headers of a stream state. `all` has the other fields of l4d_info."""

    num_gaussians: int
    sh_degree: int
    file_bytes: int
    timeline: Timeline
    layers: Sequence[Record]
    """The fields of l4d_layer_info of each layer."""
    profile: str
    level: int
    lossless: bool
    placement: Record
    rendering: Record
    presentation: Record
    metadata: Sequence[Tuple[str, str]]
    """Keys, which may repeat, and values: what encode(metadata=..) stored."""
    errors: Record
    """The largest errors of single Gaussians that the encoder states: l4d_coding_errors."""
    all: Record

    @property
    def duration(self) -> float:
        """Seconds."""
        return self.timeline.duration


def _point(detail: str, max_level: Optional[int], max_tier: Optional[int]) -> Dict[str, int]:
    """The fields of l4d_operating_point."""
    def limit(name: str, most: Optional[int]) -> int:
        return 0 if most is None else given.whole(name, most, most=63) + 1

    return {"levels": limit("max_level", max_level), "tiers": limit("max_tier", max_tier),
            "detail": DETAIL[given.choice("detail", detail, tuple(DETAIL))]}


class Decoder:
    """An open file. Several threads may use it; their calls take turns, and other Python code runs meanwhile."""

    def __init__(self, source: Source, *, threads: int = 0, tolerant: bool = False, max_memory_bytes: int = 0,
                 cache_bytes: int = 0, backend: int = 0) -> None:
        """Opens a stream; the arguments are those of open()."""
        options = struct("decoder_options", threads=threads, tolerant=int(given.flag("tolerant", tolerant)), backend=backend,
                         max_memory_bytes=max_memory_bytes, cache_bytes=cache_bytes, accept_needs=1)
        self._handle: Any = None
        self._movie: Any = None
        self._renderer: Any = None
        self._drawn: Any = None  # the operating point that the renderer has
        self._bytes: Any = None
        self._call = Call(reader=reader_of(source))
        self._user = self._call.handle()
        self._path = os.fspath(source) if isinstance(source, (str, os.PathLike)) else None
        self._name = str(source) if isinstance(source, (str, os.PathLike)) else type(source).__name__
        self._lock = threading.RLock()
        self._depth = 0  # calls of C that this thread is in
        out = ffi.new("l4d_decoder**")
        check(lib.l4d_decoder_create(options, out))
        self._handle = ffi.gc(out[0], lib.l4d_decoder_destroy)
        with self._busy():
            self._open_source(source, options)

    def _open_source(self, source: Source, options: Any) -> None:
        reader = c_reader(self._call, self._user)
        if isinstance(source, (str, os.PathLike)):
            self._check(lib.l4d_decoder_open_file(self._handle, path_bytes(source)))
        elif isinstance(source, Reader):
            self._check(lib.l4d_decoder_open(self._handle, reader))
        else:
            self._bytes = ffi.from_buffer(source)
            self._check(lib.l4d_decoder_open_memory(self._handle, self._bytes, len(self._bytes)))
        self.info = self._get_info()
        timeline, movie = ffi.new("l4d_timeline*"), ffi.new("l4dpy_movie**")
        self.timeline.to_c(timeline)
        self._call.check(lib.l4dpy_movie_open(reader, options, timeline, movie))
        if movie[0] != ffi.NULL:
            self._movie = ffi.gc(movie[0], lib.l4dpy_movie_destroy)
            ffi.release(self._handle)
            self._handle = None
            self.info = self._get_movie_info()
        elif not isinstance(source, Reader):
            self._call.reader = None  # C reads by itself

    def _read(self) -> bytes:
        """All bytes of the file."""
        with self._lock:
            if self._path is not None:
                return bytes(reader_of(self._path).read_at(0, self.info.file_bytes))
            if self._bytes is not None:
                return bytes(ffi.buffer(self._bytes))
            if self._call.reader is None:
                raise ValueError(f"the decoder of {self._name} is closed")
            return bytes(self._call.reader.read_at(0, self.info.file_bytes))

    # ---- the handle ----

    def close(self) -> None:
        """Closes the stream. Every later call fails. Raises ValueError inside of a callback of one."""
        with self._lock:
            if self._depth > 0:
                raise ValueError(f"the decoder of {self._name} is in use: it cannot be closed in a callback")
            for owned in (self._renderer, self._handle, self._movie, self._bytes):
                if owned is not None:
                    ffi.release(owned)
            self._renderer = self._handle = self._movie = self._bytes = self._call.reader = None

    def __enter__(self) -> "Decoder":
        return self

    def __exit__(self, kind: Optional[Type[BaseException]], error: Optional[BaseException],
                 trace: Optional[TracebackType]) -> None:
        self.close()

    def __del__(self) -> None:
        if hasattr(self, "_lock"):
            self.close()

    def __repr__(self) -> str:
        state = "closed, " if self._handle is self._movie is None else ""
        return (f"<Decoder of {self._name}: {state}{self.info.num_gaussians} Gaussians, "
                f"{self.info.duration:g} s, {self.info.file_bytes} bytes>")

    @contextlib.contextmanager
    def _busy(self) -> Iterator[None]:
        """Takes the turn of this thread. The decoder stays open meanwhile, whatever callbacks do."""
        with self._lock:
            self._depth += 1
            try:
                yield
            finally:
                self._depth -= 1

    @contextlib.contextmanager
    def _open(self) -> Iterator[Any]:
        """Takes the turn of this thread, and the decoder of a file of one stream."""
        with self._busy():
            if self._handle is self._movie is None:
                raise ValueError(f"the decoder of {self._name} is closed")
            if self._handle is None:
                raise Error(Status.FEATURE_UNSUPPORTED, f"{self._name} has several streams, or shows a part of one: "
                            "slice(), frames() and render() show it; `l4dcodec cut --member` takes one of them")
            yield self._handle

    @contextlib.contextmanager
    def _shown(self, time: float) -> Iterator[List[Tuple[Any, float, float]]]:
        """Takes the turn of this thread, and the decoders that show `time`: decoder, its time, and its shift."""
        with self._busy():
            if self._movie is None:
                with self._open() as handle:
                    shown = [(handle, time, 0.0)]
            else:
                count, out = ffi.new("uint64_t*"), ffi.new("l4dpy_shown[64]")
                self._call.check(lib.l4dpy_movie_show(self._movie, time, out, len(out), count))
                if count[0] > len(out):
                    raise Error(Status.LIMIT_EXCEEDED, f"{count[0]} streams show {time} s; at most {len(out)} may")
                shown = [(s.decoder, s.time, s.shift) for s in out[0:count[0]]]
            yield shown

    def _check(self, status: int, handle: Any = None) -> None:
        self._call.check(status)

    def _struct(self, name: str, get: Any, *arguments: Any) -> Record:
        out = struct(name)
        self._check(get(self._handle, *arguments, out))
        return record(out)  # type: ignore[no-any-return]

    def _get_info(self) -> Info:
        out = struct("info")
        self._check(lib.l4d_decoder_get_info(self._handle, out))
        all_ = record(out)
        layers = [self._struct("layer_info", lib.l4d_decoder_get_layer_info, i) for i in range(out.num_layers)]
        name = lib.l4d_profile_name(out.profile)
        return Info(out.num_gaussians, out.sh_degree, out.file_bytes, Timeline.of_c(out.timeline), tuple(layers),
                    "" if name == ffi.NULL else text(name), out.level, bool(out.tools & lib.L4D_TOOL_LOSSLESS),
                    all_.placement, self._struct("rendering", lib.l4d_decoder_get_rendering),
                    self._struct("presentation", lib.l4d_decoder_get_presentation), self._get_metadata(),
                    self._struct("coding_errors", lib.l4d_decoder_get_coding_errors), all_)

    def _get_metadata(self) -> Tuple[Tuple[str, str], ...]:
        pairs: List[Tuple[str, str]] = []
        out = ffi.new("const char*[2]")
        while True:
            self._check(lib.l4d_decoder_get_metadata(self._handle, len(pairs), out, out + 1))
            if out[0] == ffi.NULL:
                return tuple(pairs)
            pairs.append((text(out[0]), text(out[1])))

    def _get_movie_info(self) -> Info:
        """That of the first stream, with the times, Gaussians and bytes of the file."""
        timeline, count, first = ffi.new("l4d_timeline*"), ffi.new("uint64_t*"), ffi.new("l4d_decoder**")
        self._call.check(lib.l4dpy_movie_get(self._movie, timeline, count, first))
        self._handle = first[0]
        try:
            info = self._get_info()
        finally:
            self._handle = None  # it is the movie's
        assert self._call.reader is not None
        return dataclasses.replace(info, num_gaussians=count[0], file_bytes=self._call.reader.size(),
                                   timeline=Timeline.of_c(timeline))

    @property
    def timeline(self) -> Timeline:
        return self.info.timeline

    @property
    def duration(self) -> float:
        """Seconds."""
        return self.info.duration

    @property
    def counters(self) -> Record:
        """What the decoder has read, decoded and lost, and the memory that it holds: l4d_counters."""
        with self._open():
            return self._struct("counters", lib.l4d_decoder_get_counters)

    @property
    def losses(self) -> List[Record]:
        """What the last call left out, of a tolerant decoder: l4d_loss."""
        with self._open() as handle:
            count = ffi.new("uint64_t*")
            self._check(lib.l4d_decoder_get_losses(handle, ffi.NULL, 0, count))
            out = ffi.new("l4d_loss[]", count[0])
            self._check(lib.l4d_decoder_get_losses(handle, out, count[0], count))
            return [record(loss) for loss in out]

    # ---- Gaussians ----

    def _query(self, time: Optional[float], range: Optional[Tuple[float, float]], detail: str,
               max_level: Optional[int], max_tier: Optional[int], whole_buckets: bool) -> Any:
        if time is not None and range is not None:
            raise ValueError("`time` and `range` exclude each other")
        query = struct("query", point=_point(detail, max_level, max_tier),
                       whole_buckets=int(given.flag("whole_buckets", whole_buckets)))
        if time is not None:
            query.kind, query.time_begin = lib.L4D_QUERY_TIME, given.number("time", time)
        elif range is not None:
            query.kind, (query.time_begin, query.time_end) = lib.L4D_QUERY_RANGE, floats("range", range, 2)
        return query

    def select(self, time: Optional[float] = None, *, range: Optional[Tuple[float, float]] = None,
               detail: str = "full", max_level: Optional[int] = None, max_tier: Optional[int] = None,
               whole_buckets: bool = False) -> Record:
        """What decode() with the same arguments would decode, and its cost in bytes: l4d_selection. Reads no page."""
        query = self._query(time, range, detail, max_level, max_tier, whole_buckets)
        with self._open():
            return self._struct("selection", lib.l4d_decoder_select, query)

    def decode(self, time: Optional[float] = None, *, range: Optional[Tuple[float, float]] = None,
               detail: str = "full", max_level: Optional[int] = None, max_tier: Optional[int] = None,
               whole_buckets: bool = False, progress: Optional[Progress] = None) -> Scene:
        """Decodes the whole stream, the buckets that can be visible at `time`, or those that can be visible in
        `range`, (begin, end), in seconds. Times outside the sequence count as its ends.

        detail: "full", or "base" for colours that do not depend on the view. max_level, max_tier: the finest
        temporal level and the highest tier that are decoded. Decoded attributes are exact, whatever decodes them.
        """
        query = self._query(time, range, detail, max_level, max_tier, whole_buckets)
        with self._open() as handle:
            selection = self._struct("selection", lib.l4d_decoder_select, query)
            n, degree = selection.num_gaussians, self.info.sh_degree
            arrays: Dict[str, Any] = {
                name: np.empty(shape_of(name, n, degree), np.float64 if name == "mean_t" else np.float32)
                for name in ATTRIBUTES}
            buffers = struct("gaussian_buffers", capacity=n, mean_t_double=pointer(arrays["mean_t"], "double*"))
            for name, array in arrays.items():
                if name != "mean_t":
                    setattr(buffers, name, pointer(array))
            window = None
            if self.info.all.tools & lib.L4D_TOOL_FLAT_WINDOWS:
                window = np.empty((n, 2), np.uint32)
                buffers.window = pointer(window, "uint32_t*")
            self._call.progress = given.progress(progress)
            lib.l4d_decoder_set_progress(handle, lib.l4dpy_progress, self._user)
            status = lib.l4d_decoder_decode(handle, query, buffers)
            lib.l4d_decoder_set_progress(handle, ffi.NULL, ffi.NULL)
            self._check(status)
        if buffers.count != n:  # a tolerant decoder left something out
            arrays = {name: array[:buffers.count] for name, array in arrays.items()}
            window = None if window is None else window[:buffers.count]
        return Scene(**arrays, window=window, timeline=self.timeline, **flags_of(self.info.all.flags),
                     placement=self.info.placement, rendering=self.info.rendering,
                     presentation=self.info.presentation, source="l4d")

    def decode_cuda(self, time: Optional[float] = None, *, range: Optional[Tuple[float, float]] = None,
                    detail: str = "full", max_level: Optional[int] = None, max_tier: Optional[int] = None,
                    whole_buckets: bool = False, device: int = 0) -> Dict[str, Any]:
        """What decode() with the same arguments gives, the same bits, decoded on a CUDA device: float32 tensors of
        PyTorch under the names of l4d_cuda_gaussian_buffers, on the current stream of `device` and complete.
        `mean_t_local` is the mean time less the centre of the Gaussian's bucket; `window`, in streams with flat
        windows alone, is of int32. Needs PyTorch, and a build of this package with CUDA."""
        from .device import decode_cuda
        given.whole("device", device, most=2**31 - 1)
        query = self._query(time, range, detail, max_level, max_tier, whole_buckets)
        with self._open() as handle:
            windows = (self.info.all.tools & lib.L4D_TOOL_FLAT_WINDOWS) != 0
            return decode_cuda(handle, query, self.info.sh_degree, windows, device)

    # ---- splats ----

    def slice(self, time: float, *, sh: bool = True, axes: bool = True, covariance: bool = True, ids: bool = False,
              camera_position: Optional[Sequence[float]] = None, detail: str = "full",
              max_level: Optional[int] = None, max_tier: Optional[int] = None) -> Splats:
        """Returns the splats that are visible at `time`, in seconds, limited to the sequence, as their `time` is.

        sh, axes (quats and scales), covariance, ids: which arrays are made. With camera_position, in scene units,
        `colors` are those seen from there. detail, max_level, max_tier: as in decode(). Buckets stay decoded, so
        that the next instants cost less.
        """
        given.number("time", time)
        for name, wanted in (("sh", sh), ("axes", axes), ("covariance", covariance), ("ids", ids)):
            given.flag(name, wanted)
        shapes: Dict[str, Tuple[int, ...]] = {"position": (3,), "opacity": ()}
        if sh:
            shapes["sh"] = ((self.info.sh_degree + 1) ** 2, 3)
        if axes:
            shapes.update(rotation=(4,), scale=(3,))
        if covariance:
            shapes["covariance"] = (6,)
        if camera_position is not None:
            shapes["color"] = (3,)
        point = _point(detail, max_level, max_tier)
        with self._shown(time) as shown:
            parts = [self._slice(*stream[:2], shapes, camera_position, ids, point) for stream in shown]
        empty: Any = {name: np.empty((0, *shape), np.float32) for name, shape in shapes.items()}
        whole = parts[0] if len(parts) == 1 else {
            name: np.concatenate([part[name] for part in parts] or [empty[name]]) for name in (parts or [empty])[0]}
        get: Any = whole.get
        return Splats(self._instant(time, shown), get("position"), get("opacity"), get("rotation"), get("scale"), get("sh"),
                      get("covariance"), get("color"), get("id"), self.info.placement, self.info.rendering,
                      self.info.presentation)

    def _instant(self, time: float, shown: Sequence[Tuple[Any, float, float]]) -> float:
        """The instant that is shown where `time` is asked for."""
        if self._movie is not None and shown:  # between streams, an end of one
            _, at, shift = shown[0]
            if not math.isclose(at + shift, time, rel_tol=1e-12, abs_tol=1e-9):
                time = at + shift
        return min(max(float(time), self.timeline.time_begin), self.timeline.time_end)

    def _slice(self, handle: Any, time: float, shapes: Dict[str, Tuple[int, ...]],
               camera_position: Optional[Sequence[float]], ids: bool, point: Any) -> Dict[str, Any]:
        buffers, status = struct("splat_buffers", point=point), lib.L4D_ERR_BUFFER_TOO_SMALL
        if camera_position is not None:
            buffers.camera_position = floats("camera_position", camera_position, 3)
        # The first call fails for its capacity and counts. It is given the same arrays, so that it decodes
        # what the second one needs, too. A tolerant decoder may find more in the second call.
        while status == lib.L4D_ERR_BUFFER_TOO_SMALL:
            n = buffers.capacity = buffers.count
            arrays: Dict[str, Any] = {name: np.empty((n, *shape), np.float32) for name, shape in shapes.items()}
            if ids:
                arrays["id"] = np.empty(n, ID)
            for name, array in arrays.items():
                setattr(buffers, name, pointer(array, "l4d_gaussian_id*" if name == "id" else "float*"))
            status = lib.l4d_decoder_slice(handle, time, buffers)
        self._check(status, handle)
        return {name: array[:buffers.count] for name, array in arrays.items()}

    def frames(self, fps: Optional[float] = None, *, begin: Optional[float] = None, end: Optional[float] = None,
               prefetch: int = 2, **arguments: Any) -> Iterator[Splats]:
        """Yields the splats of one frame after another, from `begin` to before `end`, in seconds; all of the
        sequence at its own frame rate unless given. A thread slices up to `prefetch` frames ahead. arguments: those
        of slice()."""
        rate = float(self.timeline.fps) if fps is None else given.number("fps", fps, above=0)
        first = self.timeline.time_begin if begin is None else given.number("begin", begin)
        last = self.timeline.time_end if end is None else given.number("end", end)
        given.whole("prefetch", prefetch)
        count = max(0, math.ceil((last - first) * rate - 1e-6))
        # A function of its own, so that what is wrong above is told here and not where frames are taken.
        return self._frames((first + k / rate for k in range(count)), prefetch, arguments)

    def _frames(self, times: Iterator[float], prefetch: int, arguments: Dict[str, Any]) -> Iterator[Splats]:
        if prefetch <= 0:
            yield from (self.slice(time, **arguments) for time in times)
            return
        with concurrent.futures.ThreadPoolExecutor(1, "l4dcodec") as pool:
            waiting: "deque[concurrent.futures.Future[Splats]]" = deque()
            try:
                for time in times:
                    waiting.append(pool.submit(self.slice, time, **arguments))
                    if len(waiting) > prefetch:
                        yield waiting.popleft().result()
                while waiting:
                    yield waiting.popleft().result()
            finally:
                for future in waiting:
                    future.cancel()

    # ---- images ----

    def render(self, time: float, camera: Optional[Camera] = None, *, background: Sequence[float] = (0, 0, 0),
               alpha: bool = False, detail: str = "full", max_level: Optional[int] = None,
               max_tier: Optional[int] = None) -> Floats:
        """Renders the stream at `time`, in seconds, and returns [height, width, 3] floats of the scene's colour
        space, or [height, width, 4] with alpha=True, where the last one is the opacity of all splats together.

        camera: the one that the stream suggests unless given, with 960x540 pixels.
        """
        given.number("time", time)
        given.flag("alpha", alpha)
        if camera is None:
            camera = Camera.suggested(self.info.presentation)
        given.of_type("camera", camera, Camera, "None or a Camera")
        shown_by, background = camera.to_c(), floats("background", background, 3)
        point = (detail, max_level, max_tier)
        with self._shown(time) as shown:
            if self._renderer is None or self._movie is not None or self._drawn != point:
                out = ffi.new("l4d_renderer**")
                check(lib.l4d_renderer_create(ffi.NULL, out))
                self._renderer = ffi.gc(out[0], lib.l4d_renderer_destroy)
                handles, _, shifts = zip(*shown)
                self._check_render(lib.l4d_renderer_set_streams(self._renderer, handles, shifts, len(shown),
                                                                    ffi.new("l4d_operating_point*", _point(*point))))
                self._drawn = point
            rgb = np.empty((camera.height, camera.width, 3), np.float32)
            opacity = np.empty((camera.height, camera.width), np.float32) if alpha else None
            image = struct("image", rgb=pointer(rgb), alpha=pointer(opacity))
            self._check_render(lib.l4d_renderer_set_background(self._renderer, background))
            self._check_render(lib.l4d_renderer_set_time(self._renderer, shown[0][1] + shown[0][2]))
            self._check_render(lib.l4d_renderer_render(self._renderer, shown_by, image))
        return rgb if opacity is None else np.concatenate([rgb, opacity[..., None]], axis=2)

    def show(self, **arguments: Any) -> "Shown":
        """Shows the stream in a notebook: in the player, or with camera= or time= as a picture. The arguments are
        those of l4dcodec.show()."""
        from .notebook import show  # which imports this module
        return show(self, **arguments)

    def _check_render(self, status: int) -> None:
        self._call.check(status)


def open(source: Source, *, threads: int = 0, tolerant: bool = False, max_memory_bytes: int = 0,
         cache_bytes: int = 0, backend: int = 0) -> Decoder:
    """Opens a stream: a path, bytes (or bytearray, memoryview, mmap, which are not copied), or an object with
    read_at and size (Reader). Reads headers only.

    threads: 0 = one per core. tolerant: leaves out what is damaged or cannot be read, in place of failing.
    max_memory_bytes, cache_bytes, backend: as in l4d_decoder_options; 0 = its defaults.
    """
    return Decoder(source, threads=threads, tolerant=tolerant, max_memory_bytes=max_memory_bytes,
                   cache_bytes=cache_bytes, backend=backend)

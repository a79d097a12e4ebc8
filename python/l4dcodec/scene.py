# SPDX-License-Identifier: Apache-2.0
"""Scenes of 4D Gaussians, splats of an instant, and the files of other programs."""

import dataclasses
import os
import warnings
from fractions import Fraction
from typing import Any, List, Mapping, Optional, Union

import numpy as np
import numpy.typing as npt

from .core import (Call, Error, Floats, Path, Record, Source, Status, borrow, c_reader, check, ffi, lib, path_bytes,
                   pointer, reader_of, record, set_fields, struct, text)


@dataclasses.dataclass(frozen=True)
class Timeline:
    """The time span of a scene. Frame k begins at time_begin + k / fps, in seconds."""

    num_frames: int
    fps: Union[int, float, Fraction] = 30
    time_begin: float = 0.0

    @property
    def duration(self) -> float:
        """Seconds."""
        return float(self.num_frames / Fraction(self.fps))

    @property
    def time_end(self) -> float:
        return self.time_begin + self.duration

    @staticmethod
    def of_c(timeline: Any) -> "Timeline":
        return Timeline(timeline.num_frames, Fraction(timeline.fps_num, timeline.fps_den), timeline.time_begin)

    def to_c(self, timeline: Any) -> None:
        fps = Fraction(self.fps).limit_denominator(1 << 20)
        timeline.time_begin, timeline.num_frames = self.time_begin, self.num_frames
        timeline.fps_num, timeline.fps_den = fps.numerator, fps.denominator


@dataclasses.dataclass(eq=False)
class Scene:
    """N Gaussians that move and fade, as arrays; l4d_gaussians in l4d.h describes each of them."""

    position: Floats
    """[N, 3] scene units, at the reference time: mean_t, limited to the sequence if position_at_mean_time is False."""
    mean_t: npt.NDArray[Any]
    """[N] seconds, float32 or float64."""
    log_scale: Floats
    """[N, 4] natural logarithms of standard deviations: x, y, z in scene units, t in seconds."""
    rotor: Floats
    """[N, 8] s b01 b02 b12 b03 b13 b23 p."""
    opacity: Floats
    """[N] 0 to 1, or logits if opacity_logit is True."""
    sh: Floats
    """[N, (D + 1)^2, 3], D from 0 to 3; the colour is 0.5 + their sum."""
    timeline: Timeline
    window: Optional[npt.NDArray[np.uint32]] = None
    """[N, 2] frames; from `begin` to `end` - 1 the Gaussian has its whole opacity. 0, 0: it fades around mean_t."""
    position_at_mean_time: bool = True
    opacity_logit: bool = False
    placement: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    """origin [3], scale: world = origin + scale * position; coordinate_system, color_space."""
    rendering: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    """How the scene asks to be drawn: the fields of l4d_rendering."""
    presentation: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    """How it asks to be shown: the fields of l4d_presentation."""
    source: str = "python"
    """The format that the scene was read from."""
    notes: List[str] = dataclasses.field(default_factory=list)
    """The approximations that the import made, one sentence each."""

    def __len__(self) -> int:
        return len(self.opacity)

    def __repr__(self) -> str:
        return (f"<Scene of {len(self)} Gaussians, SH degree {self.sh_degree}, "
                f"{self.timeline.duration:g} s, from {self.source}>")

    @property
    def sh_degree(self) -> int:
        """D, or -1 if `sh` has not the shape of any."""
        shape = np.shape(self.sh)
        return {1: 0, 4: 1, 9: 2, 16: 3}.get(shape[1], -1) if len(shape) == 3 else -1

    def write(self, path: Path, format: str = "l4d") -> None:
        """Writes a PLY. format: "l4d", with all attributes; "ftgs", as FreeTimeGS has it, converted."""
        check(lib.l4dpy_write_ply(_native_of(self), format.encode(), path_bytes(path)))


@dataclasses.dataclass(eq=False)
class Splats:
    """The M Gaussians that are visible at an instant, under the names that gsplat gives its arguments. Arrays that
    were not wanted are None."""

    time: float
    """Seconds."""
    means: Floats
    """[M, 3] scene units."""
    opacities: Floats
    """[M] 0 to 1, with the falloff over time."""
    quats: Optional[Floats] = None
    """[M, 4] unit quaternions w x y z, from the axes of the Gaussian to those of the scene."""
    scales: Optional[Floats] = None
    """[M, 3] standard deviations, scene units."""
    sh: Optional[Floats] = None
    """[M, (D + 1)^2, 3]: gsplat's `colors`, with sh_degree=D."""
    covariance: Optional[Floats] = None
    """[M, 6] xx xy xz yy yz zz, scene units squared."""
    colors: Optional[Floats] = None
    """[M, 3] red, green, blue, as seen from the camera_position of the slice."""
    ids: Optional[npt.NDArray[Any]] = None
    """[M] layer, bucket, index: names of Gaussians that are the same in all slices of a stream."""

    def __len__(self) -> int:
        return len(self.opacities)

    def __repr__(self) -> str:
        return f"<{len(self)} splats at {self.time:g} s>"

    @property
    def covars(self) -> Floats:
        """[M, 3, 3] symmetric matrices: `covariance` in full."""
        if self.covariance is None:
            raise ValueError("the slice was made without covariances")
        return np.ascontiguousarray(self.covariance[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]]).reshape(-1, 3, 3)

    def write(self, path: Path) -> None:
        """Writes a 3DGS PLY, as `l4dcodec slice` does. It needs covariance and sh."""
        if self.covariance is None or self.sh is None:
            raise ValueError("the slice was made without covariances or without sh")
        arrays = [np.ascontiguousarray(a, np.float32)
                  for a in (self.means, self.covariance, self.opacities, self.sh)]
        c = struct("splat_buffers", capacity=len(self), count=len(self))
        c.position, c.covariance, c.opacity, c.sh = [pointer(a) for a in arrays]
        degree = int(round(arrays[3].shape[1] ** 0.5)) - 1
        check(lib.l4dpy_write_splats(c, degree, path_bytes(path)))


def read(source: Source, *, seconds: float = 0, fps: float = 0) -> Scene:
    """Reads all of a scene: a PLY of any kind that the tool reads (docs/formats.md), or a stream.

    seconds, fps: the timeline of a PLY that states none; 1 second and 30 frames a second unless given. What the
    import approximates is a warning, and in Scene.notes.
    """
    scene = _scene_of(native_of(source, seconds, fps))
    for note in scene.notes:
        warnings.warn(f"{source!r}: {note}", stacklevel=2)
    return scene


# ---- between these and C ---------------------------------------------------------------------------------

ATTRIBUTES = {"position": (3,), "mean_t": (), "log_scale": (4,), "rotor": (8,), "opacity": (), "sh": (0, 3)}
"""The shape of each, after [N]; 0 is (D + 1)^2."""


def shape_of(name: str, count: int, sh_degree: int) -> Any:
    return (count, *[n or (sh_degree + 1) ** 2 for n in ATTRIBUTES[name]])


def native_of(source: Union[Scene, Source], seconds: float = 0, fps: float = 0) -> Any:
    """An l4dpy_scene, which is destroyed with what this returns."""
    if isinstance(source, Scene):
        return _native_of(source)
    out = ffi.new("l4dpy_scene**")
    call = Call(reader=reader_of(source))
    assert call.reader is not None
    if bytes(call.reader.read_at(0, 3)) != b"ply":
        handle = call.handle()
        call.check(lib.l4dpy_read_stream(c_reader(call, handle), out))
    elif isinstance(source, (str, os.PathLike)):
        check(lib.l4dpy_read_ply(path_bytes(source), seconds, fps, out))
    else:
        raise Error(Status.INVALID_ARGUMENT, "a PLY is read by its path only")
    return ffi.gc(out[0], lib.l4dpy_destroy)


def _scene_of(native: Any) -> Scene:
    """A Scene whose arrays are the memory of `native`."""
    parts = ffi.new("l4dpy_parts*")
    lib.l4dpy_get(native, parts)
    g = parts.gaussians
    arrays = {name: borrow(getattr(g, name), shape_of(name, g.count, g.sh_degree), "f4", native)
              for name in ATTRIBUTES}
    if g.mean_t_double != ffi.NULL:
        arrays["mean_t"] = borrow(g.mean_t_double, (g.count,), "f8", native)
    window = None if g.window == ffi.NULL else borrow(g.window, (g.count, 2), "u4", native)
    return Scene(**arrays, window=window, timeline=Timeline.of_c(parts.timeline), **flags_of(g.flags),
                 placement=record(parts.placement), rendering=record(parts.rendering),
                 presentation=record(parts.presentation), source=text(parts.source),
                 notes=text(parts.notes).splitlines())


def flags_of(flags: int) -> Any:
    return {"position_at_mean_time": bool(flags & lib.L4D_POSITION_AT_MEAN_TIME),
            "opacity_logit": bool(flags & lib.L4D_OPACITY_LOGIT)}


def parts_of(scene: Scene) -> Any:
    """The l4dpy_parts of a scene, and what it borrows, as a pair. Raises Error if an array has another shape."""
    n, degree, kept = len(scene.opacity), scene.sh_degree, {}
    if degree < 0:
        raise Error(Status.INVALID_ARGUMENT, f"`sh` has the shape {list(np.shape(scene.sh))}; {n} Gaussians need "
                    f"[{n}, C, 3] with 1, 4, 9 or 16 coefficients C")
    for name in ATTRIBUTES:
        given = np.asarray(getattr(scene, name))
        double = name == "mean_t" and given.dtype == np.float64
        kept[name] = np.ascontiguousarray(given, np.float64 if double else np.float32)
        if given.shape != shape_of(name, n, degree):
            raise Error(Status.INVALID_ARGUMENT, f"`{name}` has the shape {list(given.shape)}; {n} Gaussians need "
                        f"{list(shape_of(name, n, degree))}")
    parts = ffi.new("l4dpy_parts*")
    for name in ("gaussians", "rendering", "presentation"):
        getattr(lib, f"l4d_{name}_init_")(ffi.addressof(parts, name), ffi.sizeof(getattr(parts, name)))
    g = parts.gaussians
    g.count, g.sh_degree = n, degree
    g.flags = ((lib.L4D_POSITION_AT_MEAN_TIME if scene.position_at_mean_time else 0)
               | (lib.L4D_OPACITY_LOGIT if scene.opacity_logit else 0))
    for name, array in kept.items():
        double = array.dtype == np.float64
        setattr(g, name + ("_double" if double else ""), pointer(array, "double*" if double else "float*"))
    if scene.window is not None:
        kept["window"] = np.ascontiguousarray(scene.window, np.uint32)
        g.window = pointer(kept["window"], "uint32_t*")
    parts.placement.scale = 1
    scene.timeline.to_c(parts.timeline)
    set_fields(parts.placement, scene.placement)
    set_fields(parts.rendering, scene.rendering)
    set_fields(parts.presentation, scene.presentation)
    return parts, kept


def _native_of(scene: Scene) -> Any:
    parts, kept = parts_of(scene)
    out = ffi.new("l4dpy_scene**")
    check(lib.l4dpy_copy(parts, out))
    del kept
    return ffi.gc(out[0], lib.l4dpy_destroy)

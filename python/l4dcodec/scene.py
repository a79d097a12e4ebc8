# SPDX-License-Identifier: Apache-2.0
"""Scenes of 4D Gaussians, splats of an instant, and the files of other programs."""

import collections
import dataclasses
import functools
import io
import math
import numbers
import os
import warnings
from fractions import Fraction
from typing import Any, Callable, Iterable, List, Mapping, Optional, Sequence, Union

import numpy as np
import numpy.typing as npt

from . import arguments as given
from .core import (ArgumentError, Call, Floats, Path, Record, Source, array_of, as_array, borrow, c_reader, c_string, check,
                   ffi, interruptible, lib, path_bytes, pointer, reader_of, record, set_fields, struct, text)


@dataclasses.dataclass(frozen=True)
class Timeline:
    """The time span of a scene. Frame k begins at time_begin + k / fps, in seconds. An fps of 29.97 is 30000/1001, as
    everywhere; Fraction(2997, 100) is what it says."""

    num_frames: int
    fps: Union[int, float, Fraction, "np.floating[Any]"] = 30
    time_begin: float = 0.0

    def _rate(self) -> Fraction:
        # As it is, where a file has place for it.
        if isinstance(self.fps, numbers.Rational) and not isinstance(self.fps, bool):
            exact = Fraction(int(self.fps.numerator), int(self.fps.denominator))
            if 0 < exact.numerator < 2**32 and exact.denominator < 2**32:
                return exact
        return _meant_by(given.number("timeline.fps", self.fps, least=1e-9, most=1e6))

    @property
    def duration(self) -> float:
        """Seconds."""
        return float(given.whole("timeline.num_frames", self.num_frames) / self._rate())

    @property
    def time_end(self) -> float:
        return given.number("timeline.time_begin", self.time_begin) + self.duration

    @staticmethod
    def of_c(timeline: Any) -> "Timeline":
        return Timeline(timeline.num_frames, Fraction(timeline.fps_num, timeline.fps_den), timeline.time_begin)

    def to_c(self, timeline: Any) -> None:
        fps = self._rate()
        timeline.time_begin = given.number("timeline.time_begin", self.time_begin)
        timeline.num_frames = given.whole("timeline.num_frames", self.num_frames)
        timeline.fps_num, timeline.fps_den = fps.numerator, fps.denominator


def _meant_by(fps: float) -> Fraction:
    """The frame rate that a decimal means, as set_fps in io/scene/scene.cc finds it."""
    ntsc = round(fps * 1.001)
    if fps != round(fps) and abs(fps * 1.001 - ntsc) <= 5e-6 * ntsc:
        return Fraction(ntsc * 1000, 1001)
    x, now, last = fps, (1, 0), (0, 1)  # convergents of its continued fraction
    for _ in range(32):
        whole = math.floor(x)
        following = whole * now[0] + last[0], whole * now[1] + last[1]
        if max(following) >= 2**32:
            break
        now, last = following, now
        if abs(now[0] / now[1] - fps) <= 1e-12 * fps or x == whole:
            break
        x = 1 / (x - whole)
    return Fraction(*now)


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
    """How the scene asks to be drawn: the fields of l4d_rendering. Those that are left out are as in 3D Gaussian
    splatting."""
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
        return _degree(self.sh)

    @property
    def is_static(self) -> bool:
        """Whether the Gaussians stay as they are for the whole sequence."""
        n = common_count(self, ATTRIBUTES)
        log_scale, rotor = (array_of(name, getattr(self, name), shape_of(name, n, 0), np.float32)
                            for name in ("log_scale", "rotor"))
        given.of_type("timeline", self.timeline, Timeline, "a Timeline")
        lasting = np.exp(log_scale[:, 3].astype(np.float64)) >= 8 * self.timeline.duration
        return self.window is None and bool(lasting.all()) and not rotor[:, 4:].any()

    def write(self, path: Path, format: Optional[str] = None, *, time: Optional[float] = None) -> List[str]:
        """Writes the scene in the format that the name says, as `l4dcodec convert` does: .l4d; .ply, with all
        attributes; .ftgs.ply, as FreeTimeGS has it; .stg.ply, with t, scale_t and motion; .4dgs; .safetensors, raw
        arrays; and what shows the instant `time`, in seconds: .compressed.ply, .spz, .sog, .glb, .usda, and .ply (3DGS). A
        static scene needs no `time`. format: "l4d", "ftgs", "stg", "4dgs" or "raw", for a file of any name. Ctrl-C ends it
        and leaves what was there before.

        Returns what the file does not have of the scene, a sentence each.
        """
        path_bytes(path)  # refuses what is none
        name = os.fsdecode(path).lower()
        if format is not None:
            given.choice("format", format, FORMATS)
        if time is not None:
            given.number("time", time)
        if format is None and not name.endswith((".l4d", *WHOLE, *INSTANTS)):
            raise ArgumentError(f"`path` is {os.fspath(path)!r}; it must end in .l4d, "
                                f"{', '.join([*WHOLE, *INSTANTS])}, or `format` says what it is")
        if format is None and time is None and name.endswith(".l4d"):
            from .encoder import encode  # which imports this module
            encode(self, path)
            return []
        if format is None:
            format = next((WHOLE[end] for end in WHOLE if name.endswith(end)), None)
        is_plain = name.endswith(".ply") and not name.endswith(".compressed.ply")
        if format is None and is_plain and time is None and not self.is_static:
            format = "l4d"
        if format is not None:
            if time is not None:
                raise ArgumentError(f"{path}: `time` is for files of one instant")
            return _written(functools.partial(lib.l4dpy_write_scene, _native_of(self), format.encode(), path_bytes(path)))
        if time is None and not self.is_static:
            raise ArgumentError(f"{path}: the scene changes over time and the file shows one instant: "
                        "`time` says which")
        from .decoder import open as open_stream
        from .encoder import encode
        stream = io.BytesIO()
        encode(self, stream, preset="lossless", first_view=False)
        begin, end = self.timeline.time_begin, self.timeline.time_end
        with open_stream(stream.getvalue()) as decoder:
            splats = decoder.slice((begin + end) / 2 if time is None else time, axes=False)
        notes = splats.write(path)
        if time is not None and splats.time != time:
            notes.insert(0, f"`time` {_seconds(time)} lies outside the sequence [{_seconds(begin)}, {_seconds(end)}]; "
                         f"{_seconds(splats.time)} is used")
        return notes


@dataclasses.dataclass(eq=False)
class Splats:
    """The M Gaussians that are visible at an instant, under the names that gsplat gives its arguments. Arrays that
    were not wanted are None."""

    time: float
    """Seconds: the instant that is shown, which lies in the sequence."""
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
    placement: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    """Those of the stream, as a Scene has them, for formats that have a place for them; so the next two."""
    rendering: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    presentation: Mapping[str, Any] = dataclasses.field(default_factory=dict)

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

    def write(self, path: Path) -> List[str]:
        """Writes the splats in the format that the name says: .ply (3DGS), .compressed.ply, .spz, .sog, .glb or .usda, as
        `l4dcodec slice` does. It needs covariance and sh, and numbers that all formats hold: finite ones, opacities from 0 to 1,
        and no negative variances. Returns what the file does not have of them, a sentence each."""
        path_bytes(path)  # refuses what is none
        if self.covariance is None or self.sh is None:
            raise ValueError("the slice was made without covariances or without sh")
        n, degree = common_count(self, ("means", "covariance", "opacities", "sh")), degree_of(self.sh)
        shapes = {"means": (n, 3), "covariance": (n, 6), "opacities": (n,), "sh": shape_of("sh", n, degree)}
        arrays = [array_of(name, getattr(self, name), shape, np.float32) for name, shape in shapes.items()]
        for name, array in zip(shapes, arrays):
            _check_splats(name, array)
        c = struct("splat_buffers", capacity=n, count=n)
        c.position, c.covariance, c.opacity, c.sh = [pointer(a) for a in arrays]
        name = os.fsdecode(path).lower()
        extension = next((end for end in INSTANTS if name.endswith(end)), os.path.splitext(name)[1])
        return _written(functools.partial(lib.l4dpy_write_splats, c, degree, _stated(self), c_string(extension, "path"),
                                          path_bytes(path)))


def _check_splats(name: str, array: Floats) -> None:
    """Raises Error if an array has numbers that splats cannot have, which some formats would hide."""
    wrong, wanted = ~np.isfinite(array), "finite numbers"
    if name == "opacities":
        wrong, wanted = ~((array >= 0) & (array <= 1)), "a number from 0 to 1"
    elif name == "covariance":
        wrong[:, [0, 3, 5]] |= array[:, [0, 3, 5]] < 0
        wanted = "finite numbers, of which the variances xx, yy and zz are not negative"
    rows = np.flatnonzero(wrong.any(axis=tuple(range(1, wrong.ndim))))
    if rows.size:
        raise given.wrong_value(f"{name}[{rows[0]}]", array[rows[0]].tolist(), wanted)


def _seconds(time: float) -> str:
    """A time as the tool writes it."""
    return f"{time + 0.0:.6g}" if abs(time) < 1000 or abs(time) >= 1e12 else f"{time:.3f}"


FORMATS = ("l4d", "ftgs", "stg", "4dgs", "raw")
WHOLE = {".ftgs.ply": "ftgs", ".stg.ply": "stg", ".4dgs": "4dgs", ".safetensors": "raw"}
"""Endings of files with all of a scene, and what is written."""
INSTANTS = (".compressed.ply", ".ply", ".spz", ".sog", ".glb", ".usda")


def _written(write: Callable[[Any, Any, int], int]) -> List[str]:
    """Calls a writer of the library, and returns its notes. Ctrl-C ends it."""
    cancel, notes = ffi.new("int32_t*"), ffi.new("char[]", 4096)
    interruptible(lambda: check(write(cancel, notes, len(notes))), cancel)
    return text(notes).splitlines()


def read(source: Source, *, seconds: float = 0, fps: float = 0, activated: bool = False) -> Scene:
    """Reads all of a scene: a file of any format that the tool reads (docs/formats.md), or a stream.

    seconds, fps: the timeline of a file that states none; 1 second and 30 frames a second unless given. activated:
    a PLY has opacities of 0 to 1 and lengths in the columns for logits and logarithms. What the import approximates,
    and what of these a file has no use for, is a warning, and in Scene.notes.
    """
    given.number("seconds", seconds, least=0)
    given.number("fps", fps, least=0)
    given.flag("activated", activated)
    return _with_warnings(_scene_of(native_of(source, seconds, fps, activated)), repr(source))


def _with_warnings(scene: Scene, name: str) -> Scene:
    for note in scene.notes:
        warnings.warn(f"{name}: {note}", stacklevel=3)
    return scene


def read_frames(paths: Sequence[Path], *, fps: float = 30, match: str = "auto", threads: int = 0,
                **errors: float) -> Scene:
    """Reads frames, each a file with a static scene, as one scene that shows frame k at k / fps seconds.

    match: which Gaussians of one frame are those of the next: "order" of rows, "content", "none", or "auto".
    What the readers of frames note is a warning, and in Scene.notes.
    errors: how far a Gaussian may be from that of a frame: position (of its size), scale (natural logarithm),
    rotation (degrees), color and opacity, as the option --sequence-error of the tool has them.
    """
    names = ("position", "scale", "rotation", "color", "opacity")
    matches = ("auto", "order", "content", "none")
    given.choice("match", match, matches)
    given.number("fps", fps, above=0)
    given.whole("threads", threads)
    for name in errors:
        if name not in names:
            raise TypeError(f"`{name}` is no argument of read_frames(): errors are {', '.join(names)}")
    names_of_files = [path_bytes(path, f"paths[{k}]") for k, path in enumerate(given.paths("paths", paths))]
    if any(b"\n" in name for name in names_of_files):
        raise ArgumentError("a path of a frame holds the end of a line")
    lines = b"\n".join(names_of_files)
    limits = ffi.new("double[]", [given.number(name, errors[name], least=0) if name in errors else -1 for name in names])
    out, cancel = ffi.new("l4dpy_scene**"), ffi.new("int32_t*")
    interruptible(lambda: check(lib.l4dpy_read_frames(lines, fps, matches.index(match), limits, threads, cancel, out)),
                  cancel)
    return _with_warnings(_scene_of(ffi.gc(out[0], lib.l4dpy_destroy)), "frames")


# ---- between these and C ---------------------------------------------------------------------------------

# The numbers of l4d_rendering if a scene states none.
SPLATTING = {"dilation": 0.3, "min_alpha": 1 / 255, "max_alpha": 0.999}
ATTRIBUTES = {"position": (3,), "mean_t": (), "log_scale": (4,), "rotor": (8,), "opacity": (), "sh": (0, 3)}
"""The shape of each, after [N]; 0 is (D + 1)^2."""


def count_of(name: str, values: Any) -> int:
    """How many numbers an array of one dimension has."""
    shape = as_array(name, values).shape
    if len(shape) != 1:
        raise ArgumentError(f"`{name}` has the shape {list(shape)}, not [N]")
    return shape[0]


def common_count(of: Union[Scene, Splats], names: Iterable[str]) -> int:
    """How many rows most of the arrays have, so that the one that has others is told."""
    shapes = [as_array(name, getattr(of, name)).shape for name in names]
    return collections.Counter([shape[0] for shape in shapes if shape] or [0]).most_common(1)[0][0]


def _degree(sh: Any) -> int:
    shape = as_array("sh", sh).shape
    return {1: 0, 4: 1, 9: 2, 16: 3}.get(shape[1], -1) if len(shape) == 3 and shape[2] == 3 else -1


def degree_of(sh: Any) -> int:
    """The degree of spherical harmonics [N, C, 3]. Raises Error if C is that of none."""
    degree = _degree(sh)
    if degree < 0:
        raise ArgumentError(f"`sh` has the shape {list(np.shape(sh))}, not [N, C, 3] with 1, 4, 9 or 16 coefficients C")
    return degree


def shape_of(name: str, count: int, sh_degree: int) -> Any:
    return (count, *[n or (sh_degree + 1) ** 2 for n in ATTRIBUTES[name]])


def native_of(source: Union[Scene, Source], seconds: float = 0, fps: float = 0, activated: bool = False,
              name: str = "source") -> Any:
    """An l4dpy_scene, which is destroyed with what this returns."""
    if isinstance(source, Scene):
        return _native_of(source)
    out = ffi.new("l4dpy_scene**")
    call = Call(reader=reader_of(source, name))
    assert call.reader is not None
    path, is_file = path_bytes(source) if isinstance(source, (str, os.PathLike)) else b"", ffi.new("int32_t*")
    if path:
        check(lib.l4dpy_is_scene_file(path, is_file))
    elif bytes(call.reader.read_at(0, 3)) == b"ply":
        raise ArgumentError("a PLY is read by its path only")
    if is_file[0]:
        check(lib.l4dpy_read_file(path, seconds, fps, int(activated), out))
    else:
        handle = call.handle()
        call.check(lib.l4dpy_read_stream(c_reader(call, handle), seconds, fps, int(activated), out))
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
    n, degree, kept = common_count(scene, ATTRIBUTES), degree_of(scene.sh), {}
    given.of_type("timeline", scene.timeline, Timeline, "a Timeline")
    for name in ATTRIBUTES:
        values = getattr(scene, name)
        dtype = as_array(name, values).dtype
        # float32 does not hold what is of more than 4 bytes, nor integers of 4.
        wide = dtype.itemsize > 4 or (dtype.kind in "iu" and dtype.itemsize == 4)
        double = name in ("mean_t", "position") and wide
        kept[name] = array_of(name, values, shape_of(name, n, degree), np.float64 if double else np.float32)
    parts = _stated(scene)
    g = parts.gaussians
    g.count, g.sh_degree = n, degree
    g.flags = ((lib.L4D_POSITION_AT_MEAN_TIME if given.flag("position_at_mean_time", scene.position_at_mean_time) else 0)
               | (lib.L4D_OPACITY_LOGIT if given.flag("opacity_logit", scene.opacity_logit) else 0))
    if kept["position"].dtype == np.float64:
        # As the tool does with map coordinates: less an origin, which goes to the placement.
        exact, kept["position"] = kept["position"], np.empty((n, 3), np.float32)
        lib.l4dpy_subtract_origin(pointer(exact, "double*"), n, ffi.addressof(parts, "placement"),
                                  pointer(kept["position"]))
    for name, array in kept.items():
        double = array.dtype == np.float64
        setattr(g, name + ("_double" if double else ""), pointer(array, "double*" if double else "float*"))
    if scene.window is not None:
        kept["window"] = array_of("window", scene.window, (n, 2), np.uint32)
        g.window = pointer(kept["window"], "uint32_t*")
    scene.timeline.to_c(parts.timeline)
    return parts, kept


def _stated(of: Union[Scene, Splats]) -> Any:
    """An l4dpy_parts with the placement, rendering and presentation of a scene or of splats."""
    parts = ffi.new("l4dpy_parts*")
    for name in ("gaussians", "rendering", "presentation"):
        getattr(parts, name).struct_size = ffi.sizeof(getattr(parts, name))
    parts.placement.scale = 1
    set_fields(parts.placement, of.placement, "placement")
    if not isinstance(of.placement, Record):  # that of a stream may have ids that only others know
        for name, prefix in (("coordinate_system", "L4D_COORDINATES_"), ("color_space", "L4D_COLOR_")):
            _check_id(name, getattr(parts.placement, name), prefix)
    set_fields(parts.rendering, SPLATTING, "rendering")
    set_fields(parts.rendering, of.rendering, "rendering")
    set_fields(parts.presentation, of.presentation, "presentation")
    return parts


def _check_id(name: str, value: int, prefix: str) -> None:
    """Raises Error for an id that l4d.h does not have, unless it is of those that the registry leaves to others."""
    known = {int(getattr(lib, key)): key[len(prefix):] for key in dir(lib) if key.startswith(prefix)}
    if value not in known and not 128 <= value < 256:
        names = ", ".join(f"{number} ({known[number]})" for number in sorted(known))
        raise given.wrong_value(f"placement.{name}", value, f"one of {names}, or an id of others from 128 to 255")


def _native_of(scene: Scene) -> Any:
    parts, kept = parts_of(scene)
    out = ffi.new("l4dpy_scene**")
    check(lib.l4dpy_copy(parts, out))
    del kept
    return ffi.gc(out[0], lib.l4dpy_destroy)

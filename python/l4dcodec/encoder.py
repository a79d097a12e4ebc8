# SPDX-License-Identifier: Apache-2.0
"""Encoding of scenes."""

import dataclasses
import numbers
import os
from typing import Any, BinaryIO, Dict, List, Mapping, Optional, Sequence, Tuple, Union

import numpy as np
import numpy.typing as npt

from . import arguments as given
from .core import (Call, Path, Progress, Record, Status, array_of, c_string, check, ffi, floats, lib, path_bytes, pointer,
                   record, struct, text)
from .scene import Scene, parts_of, read

WEIGHTS = ("sh", "scale", "rotor_spatial", "rotor_temporal", "alpha_t", "position", "opacity", "mean_t")
METRICS = ("sum", "gauss-newton")
VIEWS = ("unknown", "all", "some")


@dataclasses.dataclass(frozen=True, eq=False)
class Importance:
    """How much images of a scene change with each of its Gaussians, and how large each has to be for its errors to count."""

    weights: Mapping[str, npt.ArrayLike] = dataclasses.field(default_factory=dict)
    """By the names of WEIGHTS: [N], larger = more visible."""
    metric: str = "gauss-newton"
    """What the weights but alpha_t are: "gauss-newton", as `l4dcodec sensitivity` measures them, or "sum", as in the
    paper. A file of weights says so in its comment `metric`, or has sums."""
    views: str = "unknown"
    """What they were measured from: "all" views that the scene is made for, so that what shows in none is dropped, or
    "some", so that nothing is."""
    min_sizes: Optional[npt.ArrayLike] = None
    """[N] scene units, below which errors of a Gaussian do not count."""


@dataclasses.dataclass(frozen=True, eq=False)
class EncodeReport:
    """What an encode came to."""

    file_bytes: int
    raw_bytes: int
    """4 bytes for each number of the input."""
    seconds: float
    order: npt.NDArray[np.uint32]
    """[number of coded Gaussians] the index in the input of each Gaussian in the order of decode()."""
    steps: Tuple[Tuple[str, float], ...]
    """Names and seconds."""
    all: Record
    """The fields of l4d_encode_report."""

    @property
    def ratio(self) -> float:
        return self.raw_bytes / self.file_bytes

    def __repr__(self) -> str:
        return (f"<EncodeReport: {len(self.order)} Gaussians, {self.file_bytes} bytes, {self.ratio:.2f}:1, "
                f"{self.seconds:.2f} s>")


def presets() -> Dict[str, str]:
    """The presets, and what each is for."""
    out = {}
    for i in range(1000):
        name = lib.l4d_encoder_preset_name(i)
        if name == ffi.NULL:
            break
        out[text(name)] = text(lib.l4d_encoder_preset_description(i))
    return out


def parameters() -> Dict[str, Record]:
    """The parameters of encode(): for each its description, unit, min, max, initial, max_values (above 1: a list),
    integer, per_component and stable (0: it may change with each version)."""
    out: Dict[str, Record] = {}
    info = struct("parameter_info")
    while lib.l4d_encoder_parameter_info(len(out), info) == Status.OK:
        out[text(info.name)] = record(info)
    return out


def _set(encoder: Any, name: str, value: Union[float, Sequence[float]]) -> int:
    """Sets a parameter by its name, as `l4dcodec encode --set` does. Returns the status."""
    key = c_string(name.replace("_", "-"), "parameters")
    what = name if name == "quality" else f"parameters[{name!r}]"
    if isinstance(value, numbers.Real):
        return int(lib.l4d_encoder_set(encoder, key, float(value)))
    if isinstance(value, (str, bytes)) or not hasattr(value, "__len__"):
        raise given.wrong_type(what, value, "a number, or a list of numbers")
    many: List[float] = list(value)  # type: ignore[arg-type]
    return int(lib.l4d_encoder_set_list(encoder, key, floats(what, many, len(many)), len(many)))


def encode(scene: Union[Scene, Path], output: Union[Path, BinaryIO], *, preset: str = "default",
           quality: Optional[float] = None, parameters: Optional[Mapping[str, Any]] = None,
           importance: Optional[Importance] = None, metadata: Optional[Mapping[str, str]] = None,
           first_view: bool = True, seed: int = 0, threads: int = 0,
           progress: Optional[Progress] = None) -> EncodeReport:
    """Encodes a scene, or the scene of a file, to a file or to an object with write(bytes).

    preset: one of presets(). quality: fidelity in dB to aim at, 20 to 90, in place of the preset's. parameters: any
    of parameters(), with a component behind a full stop where they have one ("codebook-size.sh"). importance: estimated where it is not given. first_view: a scene whose presentation
    has no camera gets one from where much of it is seen. The file appears when it is complete. It is the same for
    any number of threads, and the same as that of `l4dcodec encode`.

    progress(done, total, stage) is called between steps. An exception that it raises cancels the encode and is
    raised again, and so is a KeyboardInterrupt; then no file is left.
    """
    path = output if isinstance(output, (str, os.PathLike)) else None
    if path is not None:
        check(lib.l4dpy_check_name(path_bytes(path, "output"), b".l4d"))
    elif not callable(getattr(output, "write", None)):
        raise given.wrong_type("output", output, "a path, or an object with write")
    for name, asked in (("parameters", parameters), ("metadata", metadata)):
        if asked is not None:
            given.mapping(name, asked, "a mapping of strings")
    if importance is not None:
        given.of_type("importance", importance, Importance, "an Importance")
    given.flag("first_view", first_view)
    options = struct("encoder_options", threads=threads, seed=seed)
    scene = scene if isinstance(scene, Scene) else read(scene)
    out = ffi.new("l4d_encoder**")
    check(lib.l4d_encoder_create(options, out))
    encoder = ffi.gc(out[0], lib.l4d_encoder_destroy)
    call = Call(progress, None if path is not None else output.write)  # type: ignore[union-attr]
    handle = call.handle()

    def run(status: int) -> None:
        call.check(status)

    run(lib.l4d_encoder_set_preset(encoder, c_string(given.choice("preset", preset, tuple(presets())), "preset")))
    if quality is not None:
        run(_set(encoder, "quality", given.number("quality", quality)))
    for name, value in (parameters or {}).items():
        run(_set(encoder, name, value))
    for key, text_ in (metadata or {}).items():
        run(lib.l4d_encoder_add_metadata(encoder, c_string(key, "metadata"), c_string(text_, f"metadata[{key!r}]")))
    parts, kept = parts_of(scene)
    if first_view and not parts.presentation.has_camera:
        check(lib.l4dpy_state_first_view(parts))
    run(lib.l4d_encoder_set_scene(encoder, ffi.addressof(parts, "gaussians"), ffi.addressof(parts, "timeline"),
                                  ffi.addressof(parts, "placement")))
    run(lib.l4d_encoder_set_rendering(encoder, ffi.addressof(parts, "rendering")))
    run(lib.l4d_encoder_set_presentation(encoder, ffi.addressof(parts, "presentation")))
    if importance is not None:
        run(lib.l4d_encoder_set_importance(encoder, _importance(importance, parts.gaussians.count, kept)))
    run(lib.l4d_encoder_set_progress(encoder, lib.l4dpy_progress, handle))
    if path is not None:
        run(lib.l4d_encoder_encode_file(encoder, path_bytes(path)))
    else:
        run(lib.l4d_encoder_encode(encoder, struct("writer", user=handle, write=lib.l4dpy_write)))
    return _report(encoder, run)


def _index(name: str, names: Sequence[str], what: str) -> int:
    return names.index(given.choice(f"importance.{what}", name, names))


def _importance(importance: Importance, count: int, kept: Dict[str, Any]) -> Any:
    """As the library takes it. kept: gets the arrays, which it borrows."""
    out = struct("importance", count=count, metric=_index(importance.metric, METRICS, "metric"),
                 views=_index(importance.views, VIEWS, "views"))

    def floats_of(name: str, values: npt.ArrayLike) -> Any:
        kept[name] = array_of(name, values, (count,), np.float32)
        return pointer(kept[name])

    for name, values in given.mapping("importance.weights", importance.weights, "a mapping of arrays").items():
        place = _index(name, WEIGHTS, "weights")
        out.weights[place] = floats_of(name, values)
    if importance.min_sizes is not None:
        out.min_sizes = floats_of("min_sizes", importance.min_sizes)
    return out


def _report(encoder: Any, run: Any) -> EncodeReport:
    report = struct("encode_report")
    run(lib.l4d_encoder_get_report(encoder, report))
    order = np.empty(report.coded_gaussians, np.uint32)
    run(lib.l4d_encoder_get_order(encoder, pointer(order, "uint32_t*"), order.size))
    steps = [(text(step.name), step.seconds) for step in report.steps[0:report.num_steps]]
    report.steps = ffi.NULL
    return EncodeReport(report.file_bytes, report.raw_bytes, report.total_seconds, order, tuple(steps), record(report))

# SPDX-License-Identifier: Apache-2.0
"""Encoding of scenes."""

import dataclasses
import os
from typing import Any, BinaryIO, Dict, Mapping, Optional, Sequence, Tuple, Union

import numpy as np
import numpy.typing as npt

from .core import Call, Error, Path, Progress, Record, Status, check, ffi, lib, path_bytes, pointer, record, struct, text
from .scene import Scene, parts_of, read

WEIGHTS = ("sh", "scale", "rotor_spatial", "rotor_temporal", "alpha_t", "position", "opacity", "mean_t")
COMPONENTS = {"sh": 0, "scale": 1, "rotor-spatial": 2, "rotor-temporal": 3}


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
    """The parameters of encode(): for each its id, description, min, max, per_component and integer."""
    out = {}
    for i in range(lib.L4D_ENC_PARAMETER_COUNT):
        info = struct("parameter_info")
        check(lib.l4d_encoder_parameter_info(i, info))
        out[text(info.name)] = Record(record(info), id=i)
    return out


def _set(encoder: Any, name: str, value: Union[float, Sequence[float]]) -> int:
    """Sets a parameter by its name, as `l4dcodec encode --set` does. Returns the status."""
    name, _, component = name.replace("_", "-").partition(".")
    if component and component not in COMPONENTS:
        raise Error(Status.INVALID_ARGUMENT, f"`{component}` is no component: {', '.join(COMPONENTS)}")
    index = COMPONENTS.get(component, lib.L4D_ALL_COMPONENTS)
    if name == "tiers":
        return int(lib.l4d_encoder_set_tiers(encoder, len(value), list(value)))  # type: ignore[arg-type]
    if name == "stages":
        return int(lib.l4d_encoder_set_stages(encoder, index, len(value), list(value)))  # type: ignore[arg-type]
    known = parameters()
    if name not in known:
        raise Error(Status.INVALID_ARGUMENT, f"`{name}` is no parameter: tiers, stages, {', '.join(known)}")
    return int(lib.l4d_encoder_set(encoder, known[name].id, index, float(value)))  # type: ignore[arg-type]


def encode(scene: Union[Scene, Path], output: Union[Path, BinaryIO], *, preset: str = "default",
           quality: Optional[float] = None, parameters: Optional[Mapping[str, Any]] = None,
           weights: Optional[Mapping[str, npt.ArrayLike]] = None, min_sizes: Optional[npt.ArrayLike] = None,
           metadata: Optional[Mapping[str, str]] = None, first_view: bool = True, seed: int = 0, threads: int = 0,
           progress: Optional[Progress] = None) -> EncodeReport:
    """Encodes a scene, or the scene of a file, to a file or to an object with write(bytes).

    preset: one of presets(). quality: fidelity in dB to aim at, 20 to 90, in place of the preset's. parameters: any
    of parameters(), with a component behind a full stop where they have one ("codebook-size.sh"), and "tiers" and
    "stages", which are lists. weights: importance, [N] each, by the names of WEIGHTS. min_sizes: [N] scene units,
    sizes below which errors of a Gaussian do not count. first_view: a scene whose presentation has no camera gets
    one from where much of it is seen. The file appears when it is complete. It is the same for
    any number of threads, and the same as that of `l4dcodec encode`.

    progress(done, total, stage) is called between steps. An exception that it raises cancels the encode and is
    raised again, and so is a KeyboardInterrupt; then no file is left.
    """
    scene = scene if isinstance(scene, Scene) else read(scene)
    out = ffi.new("l4d_encoder**")
    check(lib.l4d_encoder_create(struct("encoder_options", threads=threads, seed=seed), out))
    encoder = ffi.gc(out[0], lib.l4d_encoder_destroy)
    call = Call(progress, None if isinstance(output, (str, os.PathLike)) else output.write)
    handle = call.handle()

    def run(status: int) -> None:
        call.check(status, lambda: lib.l4d_encoder_error_message(encoder))

    run(lib.l4d_encoder_set_preset(encoder, preset.encode()))
    if quality is not None:
        run(_set(encoder, "quality", quality))
    for name, value in (parameters or {}).items():
        run(_set(encoder, name, value))
    for key, text_ in (metadata or {}).items():
        run(lib.l4d_encoder_add_metadata(encoder, key.encode(), text_.encode()))
    parts, kept = parts_of(scene)
    if first_view and not parts.presentation.has_camera:
        check(lib.l4dpy_state_first_view(parts))
    run(lib.l4d_encoder_set_scene(encoder, ffi.addressof(parts, "gaussians"), ffi.addressof(parts, "timeline"),
                                  ffi.addressof(parts, "placement")))
    run(lib.l4d_encoder_set_rendering(encoder, ffi.addressof(parts, "rendering")))
    run(lib.l4d_encoder_set_presentation(encoder, ffi.addressof(parts, "presentation")))
    for name, numbers in (weights or {}).items():
        if name not in WEIGHTS:
            raise Error(Status.INVALID_ARGUMENT, f"`{name}` is no weight: {', '.join(WEIGHTS)}")
        kept["weight " + name] = array = np.ascontiguousarray(numbers, np.float32)
        run(lib.l4d_encoder_set_weights(encoder, WEIGHTS.index(name), pointer(array), array.size))
    if min_sizes is not None:
        kept["min sizes"] = array = np.ascontiguousarray(min_sizes, np.float32)
        run(lib.l4d_encoder_set_min_sizes(encoder, pointer(array), array.size))
    run(lib.l4d_encoder_set_progress(encoder, lib.l4dpy_progress, handle))
    if call.write is None:
        run(lib.l4d_encoder_encode_file(encoder, path_bytes(output)))  # type: ignore[arg-type]
    else:
        run(lib.l4d_encoder_encode(encoder, struct("writer", user=handle, write=lib.l4dpy_write)))
    return _report(encoder, run)


def _report(encoder: Any, run: Any) -> EncodeReport:
    report = struct("encode_report")
    run(lib.l4d_encoder_get_report(encoder, report))
    order = np.empty(report.coded_gaussians, np.uint32)
    run(lib.l4d_encoder_get_order(encoder, pointer(order, "uint32_t*"), order.size))
    steps, name, seconds = [], ffi.new("const char**"), ffi.new("double*")
    for i in range(report.num_steps):
        run(lib.l4d_encoder_get_step(encoder, i, name, seconds))
        steps.append((text(name[0]), seconds[0]))
    return EncodeReport(report.file_bytes, report.raw_bytes, report.total_seconds, order, tuple(steps), record(report))

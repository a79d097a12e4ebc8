# SPDX-License-Identifier: Apache-2.0
"""Checkpoints of programs that train 3D Gaussians: gsplat's trainer, and nerfstudio's splatfacto."""

import itertools
import os
import re
import tempfile
import warnings
from typing import Any, Callable, Dict, Iterable, List, Mapping, Optional, Sequence, Set, Tuple, Union

import numpy as np
import numpy.typing as npt

from . import arguments as given
from .core import ArgumentError, Error, Path, Status
from .scene import Scene, read, read_frames
from .torch_file import Lazy, TorchFile

Checkpoint = Union[Path, Mapping[str, Any]]
"""The path of a checkpoint, or what torch.load returns of it, with tensors or arrays."""

SH0 = 0.28209479177387814  # the basis function of degree 0
SPLATFACTO = re.compile(r"((?:.*\.)?(?:gauss_params|_model)\.)(means|scales|quats|opacities|features_dc|features_rest)")
GSPLAT = {"means": "means", "scales": "scales", "quats": "quats", "opacities": "opacities", "sh0": "features_dc",
          "shN": "features_rest"}
RANK = re.compile(r"(.+)_rank(0|[1-9][0-9]*)(\.[^.]+)")
"""The name of a file of gsplat's trainer, which has the Gaussians of one GPU."""

# As in io/ply/unread_time.cc, and behind them what only checkpoints have.
TIME_WHOLE = ("t", "time", "mu_t", "duration", "lifetime", "birth", "death", "vx", "vy", "vz")
TIME_BEGIN = ("t_", "time_", "timestamp", "temporal", "velocity", "linear_velocity", "motion", "omega", "trbf", "scale_t",
              "scaling_t", "angular_velocity", "rot_r_", "duration_", "cov_t", "keyframe", "log_duration", "frame_index",
              "marginal_t", "opacity_t", "visible_from",
              "deform", "dynamic", "trajectory", "rotation_r", "quat_r", "quat1", "xyz_disp")


def read_checkpoint(source: Union[Checkpoint, Sequence[Checkpoint]], *, seconds: float = 0, fps: float = 0,
                    antialiased: bool = False, **frames: Any) -> Scene:
    """Reads a checkpoint of gsplat's trainer (ckpt_*.pt) or of nerfstudio's splatfacto (step-*.ckpt) as a static scene,
    or a list of them, the frames of a sequence, as one scene that moves. PyTorch is not needed, and nothing of a file
    is run. Where several GPUs have trained, ckpt_*_rank0.pt and those beside it of the same step are one scene, whichever
    of them is named.

    seconds, fps: the timeline, as in read(); a sequence has one of them, and 30 frames a second unless given. antialiased:
    the model was trained with that rasterize mode. frames: match, threads and errors, as in read_frames(). The scene
    has the coordinates of the training, which are not those of the capture where nerfstudio turned and scaled it.
    """
    given.number("seconds", seconds, least=0)
    given.number("fps", fps, least=0)
    given.flag("antialiased", antialiased)
    is_one = isinstance(source, (str, os.PathLike, Mapping))
    items: List[Checkpoint] = [source] if is_one else list(given.paths("source", source))  # type: ignore[list-item]
    if is_one and frames:
        raise TypeError(f"{', '.join(frames)}: of sequences only, and `source` is one checkpoint")
    if not is_one and seconds and fps:
        raise ArgumentError("the frames of a sequence have `fps` or `seconds`, not both")
    for k, item in enumerate(items):
        given.of_type("source" if is_one else f"source[{k}]", item, (str, os.PathLike, Mapping),
                      "a path, or what torch.load returns")
    with tempfile.TemporaryDirectory(prefix="l4dcodec") as folder:
        paths, programs, notes = [], set(), _FrameNotes()
        for k, parts in enumerate(_frames_of(items)):
            paths.append(os.path.join(folder, f"{k:06d}.ply"))
            programs.add(_write_ply(parts, paths[-1], notes))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            if not is_one:
                scene = read_frames(paths, fps=fps or (len(paths) / seconds if seconds else 30), **frames)
            else:
                scene = read(paths[0], seconds=seconds, fps=fps)
        scene.notes = [note.replace(folder + os.sep, "frame ")
                       for note in [*scene.notes, *notes.lines(None if is_one else len(paths))]]
    scene.source = " and ".join(sorted(programs))
    if antialiased:
        scene.rendering = {**scene.rendering, "compensation": 1}
    for note in scene.notes:
        warnings.warn(note, stacklevel=2)
    return scene


class _FrameNotes:
    """What was noted of frames, each once."""

    def __init__(self) -> None:
        self._frames: Dict[str, List[str]] = {}

    def add(self, note: str, frame: str) -> None:
        """A note of a frame, which may have others that are the same."""
        if self._frames.setdefault(note, [])[-1:] != [frame]:
            self._frames[note].append(frame)

    def lines(self, count: Optional[int]) -> List[str]:
        """The notes. count: how many frames there are; None: it is no sequence."""
        return [note if count is None else f"In {len(frames)} of {count} frames, first in {frames[0]}: {note}"
                for note, frames in self._frames.items()]


def _frames_of(items: Sequence[Checkpoint]) -> List[List[Checkpoint]]:
    """The files of each frame: several, where they are the ranks of one step."""
    frames: List[List[Checkpoint]] = []
    listed: Dict[Tuple[str, str], Set[str]] = {}  # the ranks of the last frame of a step
    for item in items:
        path = None if isinstance(item, Mapping) else os.fsdecode(item)
        match = None if path is None else RANK.fullmatch(os.path.basename(path))
        if path is None or match is None:
            frames.append([item])
            continue
        step, rank = (os.path.join(os.path.dirname(path), match[1]), match[3]), match[2]
        # A rank that comes again is the next frame, which shows the same.
        if step not in listed or rank in listed[step]:
            frames.append([*_ranks_beside(path, match)])
            listed[step] = set()
        listed[step].add(rank)
    return frames


def _ranks_beside(path: str, match: "re.Match[str]") -> List[str]:
    """The files of all ranks of the step of this one."""
    os.stat(path)  # an absent one is told as such
    folder, found = os.path.dirname(path), {}
    for name in os.listdir(folder or "."):
        other = RANK.fullmatch(name)
        if other and other.group(1, 3) == match.group(1, 3):
            found[int(other[2])] = os.path.join(folder, name)
    missing = next(k for k in itertools.count() if k not in found)
    if missing < max(found):
        raise Error(Status.IO, f"{path}: {match[1]}_rank{missing}{match[3]} is not beside it; the ranks 0 to {max(found)} "
                    "have one scene together")
    return [found[k] for k in sorted(found)]


def _write_ply(parts: Sequence[Checkpoint], path: str, notes: _FrameNotes) -> str:
    """Writes the Gaussians of checkpoints as one 3DGS PLY. Returns the name of the program that they are of."""
    names = [os.fsdecode(part) if isinstance(part, (str, os.PathLike)) else "the checkpoint" for part in parts]
    if len(parts) > 1:
        notes.add(f"The Gaussians of {len(parts)} ranks of one step were joined.", path)
    all_rows = []
    for part, name in zip(parts, names):
        file = TorchFile(part) if isinstance(part, (str, os.PathLike)) else None
        try:
            program, found, unread = _tensors_of(part if file is None else file.content, name)
            arrays = {key: _array(key, value, file, name) for key, value in found.items()}
        finally:
            if file is not None:
                file.close()
        for note in unread:
            notes.add(note, path)
        all_rows.append(_rows(program, arrays, name))
        if all_rows[-1].shape[1] != all_rows[0].shape[1]:
            raise Error(Status.CORRUPT, f"{name}: spherical harmonics of another degree than {names[0]} has")
    rows = np.concatenate(all_rows)
    with open(path, "wb") as out:
        header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(rows)}"]
        header += [f"property float {column}" for column in _columns(rows.shape[1])]
        out.write("\n".join([*header, "end_header\n"]).encode())
        out.write(rows.tobytes())
    return program


def _tensors_of(content: Any, name: str) -> Tuple[str, Dict[str, Any], List[str]]:
    """gsplat or splatfacto, its tensors under the names of splatfacto, and notes."""
    content = content if isinstance(content, Mapping) else {}
    splats, pipeline = content.get("splats", content), content.get("pipeline", content)
    if isinstance(splats, Mapping) and "means" in splats:
        if "sh0" not in splats:
            raise Error(Status.FEATURE_UNSUPPORTED, f"{name}: its colours come from a network (it has no `sh0`)")
        # Numbers beside the model may be about the time of the training.
        beside = [] if splats is content else [
            key for key, value in content.items() if isinstance(value, Mapping) or _shape(value)]
        unread = [key for key in splats if key not in GSPLAT]
        _refuse_time([key for key in [*unread, *beside] if _speaks_of_time(key)], name)
        return "gsplat", {to: splats[key] for key, to in GSPLAT.items() if key in splats}, _unread(unread, len(splats))
    models: Dict[str, Dict[str, Any]] = {}
    keys = [key for key in pipeline if isinstance(key, str)] if isinstance(pipeline, Mapping) else []
    for key in keys:
        match = SPLATFACTO.fullmatch(key)
        if match:
            models.setdefault(match[1], {})[match[2]] = pipeline[key]
    models = {prefix: found for prefix, found in models.items() if "means" in found}
    if not models:
        raise Error(Status.FEATURE_UNSUPPORTED, f"{name}: no checkpoint of gsplat (`splats`) or splatfacto "
                    "(`pipeline` with `gauss_params.means`); it has "
                    f"{', '.join(sorted(map(str, content))) or 'nothing'}")
    if len(models) > 1:
        raise Error(Status.FEATURE_UNSUPPORTED, f"{name}: {len(models)} models, and a scene is one: "
                    f"{_list_of_names(prefix + '*' for prefix in models)}; leave all but one of them out")
    (prefix, found), = models.items()
    whole = prefix[:-len("gauss_params.")] if prefix.endswith("gauss_params.") else prefix
    _refuse_time([key for key in keys if key.startswith(whole) and key[len(prefix):] not in found
                  and any(map(_speaks_of_time, key[len(whole):].split(".")))], name)
    unread = [key[len(prefix):] for key in keys if key.startswith(prefix) and key[len(prefix):] not in found]
    if whole == prefix:  # where a model has other things than Gaussians
        unread = [key for key in unread if _shape(pipeline[prefix + key])[:1] == _shape(found["means"])[:1]]
    return "splatfacto", found, _unread(unread, len(found) + len(unread))


def _speaks_of_time(key: Any) -> bool:
    """Whether what has this name is about time or motion in all likelihood."""
    name = re.sub(r"ies(?=_|$)", "y", str(key).lower().lstrip("_"))
    words = re.sub(r"s(?=_|$)", "", name).split("_")  # times, scales_t
    ends = ["_".join(words[k:]) for k in range(len(words))]
    return any(end in TIME_WHOLE or end.startswith(TIME_BEGIN) for end in ends)


def _refuse_time(keys: List[Any], name: str) -> None:
    if keys:
        raise Error(Status.FEATURE_UNSUPPORTED, f"{name}: a model of an unknown kind, whose Gaussians change over time by "
                    f"its keys {_list_of_names(keys)}: a static scene without them would be another scene; write its "
                    "Gaussians as an l4d_ply, whose columns docs/formats.md lists, or each frame as a 3DGS PLY, or leave "
                    "these keys out for a static scene")


def _unread(keys: Sequence[Any], count: int) -> List[str]:
    return [f"{len(keys)} of {count} properties were not read: {_list_of_names(keys)}."] if keys else []


def _list_of_names(names: Iterable[Any]) -> str:
    shown, most = list(map(str, names)), 20
    return ", ".join(shown[:most]) + (f" and {len(shown) - most} more" if len(shown) > most else "")


def _shape(value: Any) -> Tuple[int, ...]:
    """That of a tensor or array; () of what is none."""
    shape = value.size if isinstance(value, Lazy) else getattr(value, "shape", ())
    return tuple(shape) if isinstance(shape, Sequence) else ()


def _array(key: str, value: Any, file: Optional[TorchFile], name: str) -> npt.NDArray[Any]:
    if isinstance(value, Lazy):
        assert file is not None
        value = file.array(value)
    for step in ("detach", "cpu", "float", "numpy"):  # of tensors of PyTorch
        method: Optional[Callable[[], Any]] = getattr(value, step, None)
        value = value if method is None else method()
    try:
        return np.asarray(value, np.float32)
    except (TypeError, ValueError) as error:
        raise Error(Status.CORRUPT, f"{name}: `{key}` is no array of numbers: {error}") from error


def _rows(program: str, arrays: Dict[str, npt.NDArray[Any]], name: str) -> npt.NDArray[np.float32]:
    """[N, columns of a 3DGS PLY]."""
    means = arrays["means"]
    if means.ndim != 2 or means.shape[1] != 3:
        raise Error(Status.CORRUPT, f"{name}: `means` is {list(means.shape)}; it must be [N, 3]")
    count = len(means)
    # Of a key that has two shapes, that of the other program is taken as well.
    shapes: Dict[str, List[Tuple[int, ...]]] = {
        "scales": [(count, 3)], "quats": [(count, 4)], "opacities": [(count,), (count, 1)],
        "features_dc": [(count, 3), (count, 1, 3)]}
    called: Dict[str, str] = {}
    if program == "gsplat":
        shapes["features_dc"].reverse()
        called = {to: key for key, to in GSPLAT.items()}
    for key, possible in shapes.items():
        if key not in arrays or arrays[key].shape not in possible:
            has = list(arrays[key].shape) if key in arrays else "not there"
            raise Error(Status.CORRUPT, f"{name}: `{called.get(key, key)}` is {has}; {count} Gaussians need "
                        f"{list(possible[0])}")
    arrays["opacities"] = arrays["opacities"].reshape(count)
    base = arrays["features_dc"]
    rest = arrays.get("features_rest", np.empty((count, 0, 3), np.float32))
    if rest.ndim != 3 or rest.shape[::2] != (count, 3) or rest.shape[1] not in (0, 3, 8, 15):
        key = called.get("features_rest", "features_rest")
        raise Error(Status.FEATURE_UNSUPPORTED, f"{name}: `{key}`, the spherical harmonics, is {list(rest.shape)}; "
                    f"{count} Gaussians need [{count}, K, 3] with K of 0, 3, 8 or 15")
    base = base.reshape(count, 3)
    if program == "splatfacto" and rest.shape[1] == 0:
        # Without directional colours, what it trains is the logit of the colour.
        base = (1 / (1 + np.exp(-base.astype(np.float64))) - 0.5) / SH0
    return np.ascontiguousarray(np.concatenate(
        [arrays["means"], base, rest.transpose(0, 2, 1).reshape(count, -1), arrays["opacities"][:, None],
         arrays["scales"], arrays["quats"]], axis=1), "<f4")


def _columns(count: int) -> List[str]:
    fixed = 3 + 3 + 1 + 3 + 4
    return ["x", "y", "z", *(f"f_dc_{k}" for k in range(3)), *(f"f_rest_{k}" for k in range(count - fixed)), "opacity",
            *(f"scale_{k}" for k in range(3)), *(f"rot_{k}" for k in range(4))]

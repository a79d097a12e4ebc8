# SPDX-License-Identifier: Apache-2.0
"""Checkpoints of programs that train 3D Gaussians: gsplat's trainer, and nerfstudio's splatfacto."""

import os
import re
import tempfile
import warnings
from typing import Any, Callable, Dict, List, Mapping, Optional, Sequence, Tuple, Union

import numpy as np
import numpy.typing as npt

from . import arguments as given
from .core import ArgumentError, Error, Path, Status
from .scene import Scene, read, read_frames
from .torch_file import Lazy, TorchFile

Checkpoint = Union[Path, Mapping[str, Any]]
"""The path of a checkpoint, or what torch.load returns of it, with tensors or arrays."""

SH0 = 0.28209479177387814  # the basis function of degree 0
SPLATFACTO = re.compile(r"(?:^|\.)(?:gauss_params\.|_model\.)(means|scales|quats|opacities|features_dc|features_rest)$")
GSPLAT = {"means": "means", "scales": "scales", "quats": "quats", "opacities": "opacities", "sh0": "features_dc",
          "shN": "features_rest"}


def read_checkpoint(source: Union[Checkpoint, Sequence[Checkpoint]], *, seconds: float = 0, fps: float = 0,
                    antialiased: bool = False, **frames: Any) -> Scene:
    """Reads a checkpoint of gsplat's trainer (ckpt_*.pt) or of nerfstudio's splatfacto (step-*.ckpt) as a static scene,
    or a list of them, the frames of a sequence, as one scene that moves. PyTorch is not needed, and nothing of a file
    is run.

    seconds, fps: the timeline, as in read(); a sequence has one of them, and 30 frames a second unless given. antialiased:
    the model was trained with that rasterize mode. frames: match, threads and errors, as in read_frames(). The scene
    has the coordinates of the training, which are not those of the capture where nerfstudio turned and scaled it.
    """
    given.number("seconds", seconds, least=0)
    given.number("fps", fps, least=0)
    given.flag("antialiased", antialiased)
    is_one = isinstance(source, (str, os.PathLike, Mapping))
    scenes: List[Checkpoint] = [source] if is_one else list(given.paths("source", source))  # type: ignore[list-item]
    if is_one and frames:
        raise TypeError(f"{', '.join(frames)}: of sequences only, and `source` is one checkpoint")
    if not is_one and seconds and fps:
        raise ArgumentError("the frames of a sequence have `fps` or `seconds`, not both")
    with tempfile.TemporaryDirectory(prefix="l4dcodec") as folder:
        paths, programs = [], set()
        for k, item in enumerate(scenes):
            given.of_type("source" if is_one else f"source[{k}]", item, (str, os.PathLike, Mapping),
                          "a path, or what torch.load returns")
            paths.append(os.path.join(folder, f"{k:06d}.ply"))
            programs.add(_write_ply(item, paths[-1]))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            if not is_one:
                scene = read_frames(paths, fps=fps or (len(paths) / seconds if seconds else 30), **frames)
            else:
                scene = read(paths[0], seconds=seconds, fps=fps)
        scene.notes = [note.replace(folder + os.sep, "frame ") for note in scene.notes]
    scene.source = " and ".join(sorted(programs))
    if antialiased:
        scene.rendering = {**scene.rendering, "compensation": 1}
    for note in scene.notes:
        warnings.warn(note, stacklevel=2)
    return scene


def _write_ply(source: Checkpoint, path: str) -> str:
    """Writes the Gaussians of a checkpoint as a 3DGS PLY. Returns the name of the program that it is of."""
    name, file = "the checkpoint", None
    if isinstance(source, (str, os.PathLike)):
        name = os.fspath(source)
        file = TorchFile(source)
    try:
        program, found = _tensors_of(source if file is None else file.content, name)
        arrays = {key: _array(value, file) for key, value in found.items()}
    finally:
        if file is not None:
            file.close()
    rows = _rows(program, arrays, name)
    with open(path, "wb") as out:
        header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(rows)}"]
        header += [f"property float {column}" for column in _columns(rows.shape[1])]
        out.write("\n".join([*header, "end_header\n"]).encode())
        out.write(rows.tobytes())
    return program


def _tensors_of(content: Any, name: str) -> Tuple[str, Dict[str, Any]]:
    """gsplat or splatfacto, and its tensors, under the names of splatfacto."""
    content = content if isinstance(content, Mapping) else {}
    splats, pipeline = content.get("splats", content), content.get("pipeline", content)
    if isinstance(splats, Mapping) and "means" in splats:
        if "sh0" not in splats:
            raise Error(Status.FEATURE_UNSUPPORTED, f"{name}: its colours come from a network (it has no `sh0`)")
        return "gsplat", {to: splats[key] for key, to in GSPLAT.items() if key in splats}
    found = {}
    for key, value in pipeline.items() if isinstance(pipeline, Mapping) else ():
        match = SPLATFACTO.search(str(key))
        if match:
            found[match.group(1)] = value
    if "means" not in found:
        keys = ", ".join(sorted(map(str, content))) or "nothing"
        raise Error(Status.FEATURE_UNSUPPORTED, f"{name}: no checkpoint of gsplat (`splats`) or splatfacto "
                    f"(`pipeline` with `gauss_params.means`); it has {keys}")
    return "splatfacto", found


def _array(value: Any, file: Optional[TorchFile]) -> npt.NDArray[Any]:
    if isinstance(value, Lazy):
        assert file is not None
        value = file.array(value)
    for step in ("detach", "cpu", "float", "numpy"):  # of tensors of PyTorch
        method: Optional[Callable[[], Any]] = getattr(value, step, None)
        value = value if method is None else method()
    return np.asarray(value, np.float32)


def _rows(program: str, arrays: Dict[str, npt.NDArray[Any]], name: str) -> npt.NDArray[np.float32]:
    """[N, columns of a 3DGS PLY]."""
    count = len(arrays["means"])
    shapes = {"means": (count, 3), "scales": (count, 3), "quats": (count, 4), "opacities": (count,)}
    if arrays.get("opacities", np.empty(0)).shape == (count, 1):
        arrays["opacities"] = arrays["opacities"][:, 0]
    for key, shape in shapes.items():
        if key not in arrays or arrays[key].shape != shape:
            has = list(arrays[key].shape) if key in arrays else "not there"
            raise Error(Status.CORRUPT, f"{name}: `{key}` is {has}; {count} Gaussians need {list(shape)}")
    base = arrays.get("features_dc", np.empty(0))
    rest = arrays.get("features_rest", np.empty((count, 0, 3), np.float32))
    if base.size != 3 * count or rest.ndim != 3 or rest.shape[::2] != (count, 3) or rest.shape[1] not in (0, 3, 8, 15):
        raise Error(Status.FEATURE_UNSUPPORTED, f"{name}: spherical harmonics {list(base.shape)} and {list(rest.shape)}; "
                    f"{count} Gaussians need {count} x 3, and [{count}, K, 3] with K of 0, 3, 8 or 15")
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

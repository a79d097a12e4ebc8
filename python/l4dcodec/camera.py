# SPDX-License-Identifier: Apache-2.0
"""Cameras, as gsplat and OpenCV have them."""

import dataclasses
import math
import os
import warnings
from typing import Any, Mapping, Sequence, Tuple

import numpy as np
import numpy.typing as npt

from . import arguments as given
from .core import ArgumentError, Path, array_of, as_array, check, ffi, floats, lib, path_bytes, struct, text


@dataclasses.dataclass(eq=False)
class Camera:
    """A pinhole camera. Its axes are x right, y down, z forward; the centre of the first pixel is (0.5, 0.5)."""

    width: int
    """Pixels."""
    height: int
    K: npt.ArrayLike
    """[3, 3] fx 0 cx, 0 fy cy, 0 0 1, in pixels."""
    viewmat: npt.ArrayLike
    """[4, 4] or [3, 4], from the scene to the camera: a rotation and a translation."""
    near_plane: float = 0.02
    """Scene units."""

    @staticmethod
    def call_on(position: Sequence[float], target: Sequence[float], up: Sequence[float] = (0, 1, 0), *,
                fov: float = math.pi / 3, width: int = 960, height: int = 540) -> "Camera":
        """A camera at `position` that looks at `target`. fov: vertical field of view in radians."""
        eye = np.array(floats("position", position, 3))
        forward = np.array(floats("target", target, 3)) - eye
        above = np.array(floats("up", up, 3))
        for name, size in (("width", width), ("height", height)):
            given.whole(name, size, least=1)
        if not 0 < given.number("fov", fov) < math.pi:
            raise given.wrong_value("fov", fov, "an angle in radians, above 0 and below pi")
        if not forward.any():
            raise ArgumentError("`position` and `target` are one point: the camera looks nowhere")
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, above)
        if not np.linalg.norm(right) > 1e-9 * np.linalg.norm(above):
            raise ArgumentError(f"`up` is {given.shown(up)}; it must be no direction in which the camera looks")
        right /= np.linalg.norm(right)
        rotation = np.stack([right, np.cross(forward, right), forward])
        viewmat = np.concatenate([rotation, (-rotation @ eye)[:, None]], axis=1)
        focal = height / 2 / math.tan(fov / 2)
        K = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]])
        return Camera(width, height, K, viewmat)

    @staticmethod
    def suggested(presentation: Mapping[str, Any], width: int = 960, height: int = 540) -> "Camera":
        """The first camera that a scene suggests. Raises ValueError if it suggests none."""
        given.mapping("presentation", presentation, "the presentation of a scene or of a stream")
        if not presentation.get("has_camera"):
            raise ValueError("the scene suggests no camera: give one, as Camera.call_on(position, target)")
        return Camera.call_on(presentation["camera_position"], presentation["camera_target"],
                              presentation["camera_up"], fov=presentation["camera_fov"], width=width, height=height)

    def to_c(self) -> Any:
        matrices = []
        for name, matrix in (("K", self.K), ("viewmat", self.viewmat)):
            values = as_array(name, matrix)
            matrices.append(array_of(name, values, values.shape, np.float64))
        K, pose = matrices
        given.number("near_plane", self.near_plane, above=0)
        for name, size in (("width", self.width), ("height", self.height)):
            given.whole(name, size, least=1)
        if K.shape != (3, 3) or pose.shape not in ((3, 4), (4, 4)):
            raise ValueError(f"K is {list(K.shape)} and viewmat {list(pose.shape)}; "
                             "they must be [3, 3] and [4, 4] or [3, 4]")
        off_pinhole = [K[0, 1], K[1, 0], K[2, 0], K[2, 1], K[2, 2] - 1]
        if not np.abs(off_pinhole).max() <= 1e-6 * max(1, abs(K[0, 0])):
            raise ValueError("K is no matrix of a pinhole camera without skew: fx 0 cx, 0 fy cy, 0 0 1")
        if not pose[:3, :3].any():  # to C it means the identity
            raise ValueError("viewmat begins with zeros, which are no rotation")
        if len(pose) == 4 and not np.abs(pose[3] - [0, 0, 0, 1]).max() <= 1e-6:
            raise ValueError("viewmat does not end in the row 0 0 0 1")
        return struct("camera", width=self.width, height=self.height, fx=K[0, 0], fy=K[1, 1], cx=K[0, 2], cy=K[1, 2],
                      world_to_camera=[float(x) for x in pose[:3].ravel()], near_plane=self.near_plane)


def read_cameras(path: Path) -> "Tuple[Tuple[int, Camera], ...]":
    """The cameras of a cameras.json, transforms.json or poses_bounds.npy (docs/formats.md), as (id, camera).
    Distortions of lenses are left out. What is assumed is a warning."""
    count, notes = ffi.new("uint64_t*"), ffi.new("char[]", 4096)
    check(lib.l4dpy_read_cameras(path_bytes(path), ffi.NULL, ffi.NULL, 0, count, notes, len(notes)))
    for note in text(notes).splitlines():
        warnings.warn(f"{os.fspath(path)}: {note}", stacklevel=2)
    n = count[0]
    cameras, ids = ffi.new("l4d_camera[]", n), ffi.new("int32_t[]", n)
    check(lib.l4dpy_read_cameras(path_bytes(path), cameras, ids, n, count, notes, len(notes)))
    out = []
    for i, c in zip(ids, cameras):
        K = np.array([[c.fx, 0, c.cx], [0, c.fy, c.cy], [0, 0, 1]])
        viewmat = np.concatenate([np.array(list(c.world_to_camera)).reshape(3, 4), [[0, 0, 0, 1]]])
        out.append((i, Camera(c.width, c.height, K, viewmat, c.near_plane)))
    return tuple(out)

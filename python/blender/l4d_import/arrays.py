# SPDX-License-Identifier: Apache-2.0
"""Splats of an instant as arrays that Blender takes. Needs l4dcodec and no Blender."""

import dataclasses
import io
import warnings
from collections import OrderedDict
from typing import Any, List, Optional, Sequence, Tuple

import l4dcodec
import numpy as np
import numpy.typing as npt

RIGHT_UP_BACK = 1  # L4D_COORDINATES_RIGHT_UP_BACK
LINEAR_SRGB = 1  # L4D_COLOR_LINEAR_SRGB
Floats = npt.NDArray[np.float32]
CACHE_BYTES = 256 << 20
SH0 = 0.28209479177387814  # the basis function of degree 0


@dataclasses.dataclass
class Points:
    """M Gaussians, in the scene's units and axes."""

    position: Floats
    """[M, 3]"""
    scale: Floats
    """[M, 3] standard deviations"""
    quaternion: Floats
    """[M, 4] w x y z"""
    rotation: Floats
    """[M, 3] the same as angles in Blender's order XYZ, radians"""
    opacity: Floats
    """[M] 0 to 1"""
    color: Floats
    """[M, 4] linear red, green, blue, and 1"""

    @property
    def nbytes(self) -> int:
        return sum(getattr(self, field.name).nbytes for field in dataclasses.fields(self))


class Stream:
    """An open scene, and the last instants that it was asked for."""

    def __init__(self, paths: Sequence[str], seconds: float = 0, fps: float = 0) -> None:
        """paths: a file, or the files of a sequence of frames. seconds, fps: as in l4dcodec.read()."""
        self.notes: List[str] = []
        self.decoder = self._open(paths, seconds, fps)
        self._cache: "OrderedDict[Any, Points]" = OrderedDict()

    def _open(self, paths: Sequence[str], seconds: float, fps: float) -> l4dcodec.Decoder:
        if len(paths) == 1:
            try:
                return l4dcodec.open(paths[0])
            except l4dcodec.Error as error:
                if error.status != l4dcodec.Status.NOT_L4D:
                    raise
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # they are in the notes
            scene = (l4dcodec.read(paths[0], seconds=seconds, fps=fps) if len(paths) == 1
                     else l4dcodec.read_frames(paths, fps=fps or 30))
        self.notes = scene.notes
        stream = io.BytesIO()
        l4dcodec.encode(scene, stream, preset="lossless")
        return l4dcodec.open(stream.getvalue())

    def at(self, time: float, eye: Optional[Sequence[float]] = None) -> Points:
        """The Gaussians at `time`, in seconds. eye: where colours are seen from; without it they are those that
        depend on no view."""
        key = (time, None if eye is None else tuple(eye))
        if key in self._cache:
            self._cache.move_to_end(key)
            return self._cache[key]
        points = points_of(self.decoder, time, eye)
        self._cache[key] = points
        while len(self._cache) > 1 and sum(p.nbytes for p in self._cache.values()) > CACHE_BYTES:
            self._cache.popitem(last=False)
        return points

    def up(self) -> str:
        """Which axis of the scene points up: "Y", "-Y" or "Z"."""
        axes = self.decoder.info.placement.coordinate_system
        if axes != 0:
            return "Y" if axes == RIGHT_UP_BACK else "-Y"
        view = self.decoder.info.presentation
        if not view.has_camera:
            return "-Y"  # what captures come with
        _, y, z = view.camera_up
        return "Z" if z > abs(y) else "Y" if y > 0 else "-Y"


def points_of(decoder: l4dcodec.Decoder, time: float, eye: Optional[Sequence[float]] = None) -> Points:
    """The slice of a stream at `time`, in seconds."""
    seen = eye is not None
    splats = decoder.slice(time, covariance=False, sh=not seen, camera_position=eye,
                           detail="full" if seen else "base")
    assert splats.quats is not None and splats.scales is not None
    if splats.colors is not None:
        rgb = np.clip(splats.colors, 0, 1)
    else:
        assert splats.sh is not None
        rgb = np.clip(0.5 + SH0 * splats.sh[:, 0], 0, 1)
    if decoder.info.placement.color_space != LINEAR_SRGB:
        rgb = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    color = np.ones((len(splats), 4), np.float32)
    color[:, :3] = rgb
    return Points(splats.means, splats.scales, splats.quats, euler_of(splats.quats), splats.opacities, color)


def euler_of(quats: Floats) -> Floats:
    """[M, 3] angles around x, y and z, applied in this order, of [M, 4] unit quaternions w x y z."""
    w, x, y, z = quats.astype(np.float64).T
    sine = 2 * (w * y - x * z)
    cosine = np.hypot(1 - 2 * (y * y + z * z), 2 * (x * y + w * z))
    # Where y is a quarter of a turn, x and z turn around the same axis: all of it goes to x.
    locked = cosine < 1e-6
    around_x = np.where(locked, 2 * np.arctan2(x, w), np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)))
    around_z = np.where(locked, 0, np.arctan2(2 * (x * y + w * z), 1 - 2 * (y * y + z * z)))
    angles: Floats = np.stack([around_x, np.arctan2(sine, cosine), around_z], axis=1).astype(np.float32)
    return angles


def turn_of(up: str) -> "Tuple[Tuple[float, ...], ...]":
    """The rotation from the scene's axes to Blender's, where z is up."""
    if up == "Z":
        return (1, 0, 0), (0, 1, 0), (0, 0, 1)
    sign = 1 if up == "Y" else -1
    return (1, 0, 0), (0, 0, -sign), (0, sign, 0)

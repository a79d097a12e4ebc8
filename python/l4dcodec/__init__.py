# SPDX-License-Identifier: Apache-2.0
"""l4dcodec: streams of long dynamic Gaussian-splat scenes.

    with l4dcodec.open("scene.l4d") as stream:
        splats = stream.slice(2.5)          # means, quats, scales, opacities, sh: numpy arrays
        scene = stream.decode()             # all 4D Gaussians
    l4dcodec.encode(scene, "again.l4d")

Lengths are scene units, times seconds, angles radians.
"""

from .camera import Camera, read_cameras
from .checkpoint import read_checkpoint
from .core import Error, Reader, Record, Status, Violation, lib, text
from .decoder import Decoder, Info, open
from .encoder import EncodeReport, Importance, encode, parameters, presets
from .files import Comparison, ErrorStatistics, compare, validate
from .notebook import Shown, show
from .scene import Scene, Splats, Timeline, read, read_frames

__version__ = text(lib.l4d_version_string())
__all__ = ["Camera", "Comparison", "Decoder", "EncodeReport", "Error", "ErrorStatistics", "Importance", "Info", "Reader",
           "Record", "Scene", "Shown", "Splats", "Status", "Timeline", "Violation", "compare", "encode", "open", "parameters",
           "presets", "read", "read_cameras", "read_checkpoint", "read_frames", "show", "validate"]

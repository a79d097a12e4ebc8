# SPDX-License-Identifier: Apache-2.0
"""l4dcodec: streams of long dynamic Gaussian-splat scenes.

    with l4dcodec.open("scene.l4d") as stream:
        splats = stream.slice(2.5)          # means, quats, scales, opacities, sh: numpy arrays
        scene = stream.decode()             # all 4D Gaussians
    l4dcodec.encode(scene, "again.l4d")

Lengths are scene units, times seconds, angles radians.
"""

from .camera import Camera, read_cameras
from .core import Error, Reader, Record, Status, Violation, lib, text
from .decoder import Decoder, Info, open
from .encoder import EncodeReport, encode, parameters, presets
from .files import Comparison, ErrorStatistics, compare, validate
from .scene import Scene, Splats, Timeline, read

__version__ = text(lib.l4d_version_string())
__all__ = ["Camera", "Comparison", "Decoder", "EncodeReport", "Error", "ErrorStatistics", "Info", "Reader", "Record",
           "Scene", "Splats", "Status", "Timeline", "Violation", "compare", "encode", "open", "parameters", "presets",
           "read", "read_cameras", "validate"]

# SPDX-License-Identifier: Apache-2.0
"""Points on what cameras see of a scene in Blender, for `l4dtrain train --init`."""

import math
import random
import struct

import bpy
from mathutils import Vector

COLUMNS = ("x", "y", "z", "red", "green", "blue", "t")
PROPERTIES = "".join(f"property float {name}\n" for name in COLUMNS)


def to_srgb(value):
    return 12.92 * value if value <= 0.0031308 else 1.055 * value ** (1 / 2.4) - 0.055


def color_of(thing):
    shader = thing.data.materials[0].node_tree.nodes["Principled BSDF"]
    return [to_srgb(c) for c in shader.inputs["Base Color"].default_value[:3]]


class Points:
    """Half of the points of an instant lie on what moves, which fills little of the images."""

    def __init__(self, cameras, aspect, moving, seed=0):
        self.cameras, self.aspect, self.moving = cameras, aspect, {thing.name for thing in moving}
        self.random = random.Random(seed)
        self.rows = []

    def _ray(self):
        camera = self.random.choice(self.cameras)
        half = math.tan(camera.data.angle_x / 2)
        ahead = Vector((self.random.uniform(-half, half),
                        self.random.uniform(-half, half) / self.aspect, -1))
        return camera.matrix_world.translation, camera.matrix_world.to_3x3() @ ahead

    def add(self, count, seconds, most_rays=100):
        """Adds `count` points of this instant, or fewer if `most_rays` a point find no more."""
        bpy.context.view_layer.update()
        graph = bpy.context.evaluated_depsgraph_get()
        wanted = {True: count // 2, False: count - count // 2}
        for _ in range(most_rays * count):
            is_hit, place, _, _, thing, _ = bpy.context.scene.ray_cast(graph, *self._ray())
            moves = is_hit and thing.name in self.moving
            if not is_hit or wanted[moves] == 0:
                continue
            wanted[moves] -= 1
            self.rows.append((*place, *color_of(thing), seconds))
            if not any(wanted.values()):
                break

    def write(self, path):
        head = (f"ply\nformat binary_little_endian 1.0\nelement vertex {len(self.rows)}\n"
                f"{PROPERTIES}end_header\n")
        path.write_bytes(head.encode() + b"".join(struct.pack("<7f", *row) for row in self.rows))

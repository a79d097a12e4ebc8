# SPDX-License-Identifier: Apache-2.0
"""Blender add-on: imports streams (.l4d) and the other scenes that l4dcodec reads, and shows them along the timeline."""

import bpy
from bpy.app.handlers import persistent

from . import cloud, operators

bl_info = {
    "name": "4D Gaussian splats (.l4d)",
    "author": "the authors of l4dcodec",
    "version": (0, 1, 0),
    "blender": (3, 4, 0),
    "location": "File > Import > 4D Gaussian splats",
    "description": "Imports dynamic Gaussian-splat scenes, which follow the frames of the timeline",
    "category": "Import-Export",
}


# After the frame is evaluated, so that an animated camera is where it belongs; Blender evaluates what changed again.
@persistent
def follow_frame(scene, depsgraph=None):
    cloud.show_frame(scene or bpy.context.scene)  # loading names none


@persistent
def forget_streams(*_):
    cloud.forget()


HANDLERS = (("frame_change_post", follow_frame), ("load_pre", forget_streams), ("load_post", follow_frame))


def register():
    for kind in operators.CLASSES:
        bpy.utils.register_class(kind)
    bpy.types.Object.l4d = bpy.props.PointerProperty(type=operators.L4dSettings)
    bpy.types.TOPBAR_MT_file_import.append(operators.add_to_menu)
    for name, handler in HANDLERS:
        getattr(bpy.app.handlers, name).append(handler)


def unregister():
    for name, handler in HANDLERS:
        getattr(bpy.app.handlers, name).remove(handler)
    bpy.types.TOPBAR_MT_file_import.remove(operators.add_to_menu)
    del bpy.types.Object.l4d
    for kind in reversed(operators.CLASSES):
        bpy.utils.unregister_class(kind)
    cloud.forget()

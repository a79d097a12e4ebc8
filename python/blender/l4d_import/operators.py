# SPDX-License-Identifier: Apache-2.0
"""What people see of the add-on: the entry of the menu, its options, and the panel of an object."""

import os

import bpy
from bpy.props import BoolProperty, CollectionProperty, EnumProperty, FloatProperty, StringProperty
from bpy_extras.io_utils import ImportHelper

from . import cloud

EXTENSIONS = ("l4d", "ply", "spz", "sog", "splat", "ksplat", "splatv", "4dgs", "glb", "gltf", "safetensors")


def again(self, context):
    cloud.show_frame(context.scene)


class L4dSettings(bpy.types.PropertyGroup):
    """What an object shows."""

    paths: StringProperty(name="Files", description="A scene, or the frames of a sequence, one a line")
    seconds: FloatProperty(name="Seconds", description="Length of a scene whose file states none; 0: 1 second")
    fps: FloatProperty(name="Frame rate", description="Of a file that states none; 0: 30")
    start: FloatProperty(name="First frame", description="The frame at which the scene begins", update=again)
    speed: FloatProperty(name="Speed", default=1, update=again)
    from_camera: BoolProperty(name="Colours from Camera", update=again,
                              description="Colours as the scene's camera sees them, in place of those of no view")
    problem: StringProperty()


class ImportL4d(bpy.types.Operator, ImportHelper):
    """Import a dynamic Gaussian-splat scene, or several files that are its frames"""

    bl_idname = "import_scene.l4d"
    bl_label = "Import 4D Gaussian Splats"
    bl_options = {"UNDO", "PRESET"}

    filename_ext = ".l4d"
    filter_glob: StringProperty(default=";".join("*." + name for name in EXTENSIONS), options={"HIDDEN"})
    files: CollectionProperty(type=bpy.types.OperatorFileListElement, options={"HIDDEN", "SKIP_SAVE"})
    directory: StringProperty(subtype="DIR_PATH", options={"HIDDEN", "SKIP_SAVE"})
    up: EnumProperty(name="Up", default="AUTO", items=[
        ("AUTO", "Automatic", "What the scene states, or else its first view"),
        ("Y", "Y", ""), ("-Y", "-Y", "As captures have it"), ("Z", "Z", "")])
    from_camera: BoolProperty(name="Colours from Camera", default=False,
                              description="Colours as the scene's camera sees them, in place of those of no view")
    with_camera: BoolProperty(name="Camera", default=True, description="Add the camera that the scene suggests")
    set_up: BoolProperty(name="Set Up Scene", default=True,
                         description="Frame rate, last frame, view transform Standard, transparent bounces")
    seconds: FloatProperty(name="Seconds", min=0,
                           description="Length of a scene whose file states none; 0: 1 second")
    fps: FloatProperty(name="Frame rate", min=0, description="Of a file that states none; 0: 30")

    def execute(self, context):
        names = sorted(item.name for item in self.files if item.name)
        paths = [os.path.join(self.directory, name) for name in names] if len(names) > 1 else [self.filepath]
        try:
            item, notes = cloud.add(context, paths, self.seconds, self.fps, self.up, self.from_camera,
                                    self.with_camera, self.set_up)
        except Exception as error:  # of the file: the message says what is wrong with it
            self.report({"ERROR"}, f"{os.path.basename(paths[0])}: {error}")
            return {"CANCELLED"}
        for note in notes:
            self.report({"INFO"}, note)
        for other in context.selected_objects:
            other.select_set(False)
        item.select_set(True)
        context.view_layer.objects.active = item
        return {"FINISHED"}


class L4dPanel(bpy.types.Panel):
    """The settings of an object that shows a stream."""

    bl_idname = "OBJECT_PT_l4d"
    bl_label = "4D Gaussian Splats"
    bl_space_type, bl_region_type, bl_context = "PROPERTIES", "WINDOW", "object"

    @classmethod
    def poll(cls, context):
        return context.object is not None and context.object.l4d.paths != ""

    def draw(self, context):
        item, layout = context.object, self.layout
        layout.use_property_split = True
        layout.label(text=f"{len(item.data.vertices):,} Gaussians at this frame")
        for name in ("start", "speed", "from_camera"):
            layout.prop(item.l4d, name)
        if item.l4d.problem:
            layout.label(text=item.l4d.problem, icon="ERROR")


CLASSES = (L4dSettings, ImportL4d, L4dPanel)


def add_to_menu(self, context):
    self.layout.operator(ImportL4d.bl_idname, text="4D Gaussian splats (.l4d and others)")

# SPDX-License-Identifier: Apache-2.0
"""Objects that show a scene: a mesh with a vertex for each Gaussian, filled anew for each frame."""

import bpy
import numpy as np
from mathutils import Matrix, Vector

from . import arrays, nodes

ATTRIBUTES = (("scale", "FLOAT_VECTOR"), ("rotation", "FLOAT_VECTOR"), ("quaternion", "QUATERNION"),
              ("opacity", "FLOAT"), ("color", "FLOAT_COLOR"))
FIELDS = {"FLOAT": "value", "FLOAT_VECTOR": "vector", "FLOAT_COLOR": "color", "QUATERNION": "value"}
TRANSPARENT_BOUNCES, CERTAIN_BOUNCES = 256, 32

streams = {}  # open ones, by what they were opened with


def forget():
    """Closes all streams."""
    streams.clear()


def stream_of(settings):
    key = (settings.paths, settings.seconds, settings.fps)
    if key not in streams:
        paths = [bpy.path.abspath(path) for path in settings.paths.split("\n")]
        streams[key] = arrays.Stream(paths, settings.seconds, settings.fps)
    return streams[key]


def time_of(scene, settings, timeline):
    """Seconds of the stream at the frame that `scene` is at."""
    seconds = (scene.frame_current_final - settings.start) * scene.render.fps_base / scene.render.fps
    time = timeline.time_begin + seconds * settings.speed
    return min(max(time, timeline.time_begin), timeline.time_end)


def show_frame(scene):
    """Brings all objects of `scene` that show a stream to its frame."""
    for item in scene.objects:
        if item.type == "MESH" and item.l4d.paths:
            show(scene, item)


def show(scene, item):
    settings, eye = item.l4d, None
    try:
        stream = stream_of(settings)
    except Exception as error:  # a file that is gone must not end a render of all the rest
        settings.problem = str(error)
        return
    if settings.from_camera and scene.camera is not None:
        eye = tuple(item.matrix_world.inverted_safe() @ scene.camera.matrix_world.translation)
    time = time_of(scene, settings, stream.decoder.timeline)
    points = stream.at(time, eye)
    settings.problem = ""
    shown = (time, eye)
    if shown_by.get(item.data.name) != shown or len(item.data.vertices) != len(points.opacity):
        fill(item.data, points)
        shown_by[item.data.name] = shown


shown_by = {}  # what meshes have, by their names


def fill(mesh, points):
    """Makes the Gaussians the vertices of a mesh."""
    count = len(points.opacity)
    if len(mesh.vertices) != count:
        mesh.clear_geometry()
        mesh.vertices.add(count)
    mesh.vertices.foreach_set("co", flat(points.position))
    known = bpy.types.Attribute.bl_rna.properties["data_type"].enum_items.keys()
    for name, kind in ATTRIBUTES:
        if kind not in known:
            kind = "FLOAT_COLOR"  # four numbers, as quaternions have in Blender before 4.0
        attribute = mesh.attributes.get(name) or mesh.attributes.new(name, kind, "POINT")
        attribute.data.foreach_set(FIELDS[kind], flat(getattr(points, name)))
    mesh.update()


def flat(array):
    return np.ascontiguousarray(array, np.float32).ravel()


def add(context, paths, seconds, fps, up, from_camera, with_camera, set_up):
    """Adds the object that shows a scene. Returns it, and what the import approximated, a sentence each."""
    scene = context.scene
    name = bpy.path.display_name_from_filepath(paths[0])
    item = bpy.data.objects.new(name, bpy.data.meshes.new(name))
    settings = item.l4d
    settings.paths, settings.seconds, settings.fps = "\n".join(paths), seconds, fps
    settings.start, settings.from_camera = scene.frame_start, from_camera
    try:
        stream = stream_of(settings)
    except Exception:
        mesh = item.data
        bpy.data.objects.remove(item)
        bpy.data.meshes.remove(mesh)
        raise
    info = stream.decoder.info
    turn = Matrix(arrays.turn_of(stream.up() if up == "AUTO" else up)).to_4x4()
    item.matrix_world = turn @ Matrix.Scale(info.placement.scale, 4)
    item["l4d_origin"] = info.placement.origin  # of the world, too large for Blender's numbers
    item.visible_shadow = False
    context.collection.objects.link(item)
    modifier = item.modifiers.new("Splats", "NODES")
    modifier.node_group = nodes.splat_nodes()
    for material in modifier.node_group.nodes:
        if material.type == "SET_MATERIAL":  # so that they are listed with the object
            item.data.materials.append(material.inputs["Material"].default_value)
    if set_up:
        set_up_scene(scene, info.timeline)
    if with_camera and info.presentation.has_camera:
        add_camera(context, item, info.presentation)
    context.view_layer.update()
    show(scene, item)
    return item, stream.notes


def set_up_scene(scene, timeline):
    """The frames of the stream, and what a render of many layers wants."""
    rate = timeline.fps
    scene.render.fps, scene.render.fps_base = round(rate), round(rate) / float(rate)
    scene.frame_end = scene.frame_start + timeline.num_frames - 1
    scene.view_settings.view_transform = "Standard"  # colours are those of the scene
    if hasattr(scene, "cycles"):
        scene.cycles.transparent_max_bounces = max(scene.cycles.transparent_max_bounces, TRANSPARENT_BOUNCES)
        # Cycles ends paths by chance before that, which is noise: few Gaussians behind so many are seen.
        scene.cycles.min_transparent_bounces = max(scene.cycles.min_transparent_bounces, CERTAIN_BOUNCES)


def add_camera(context, item, view):
    """The first camera that the stream suggests, which becomes that of the scene."""
    eye, target, up = (Vector(v) for v in (view.camera_position, view.camera_target, view.camera_up))
    back = (eye - target).normalized()
    right = up.cross(back).normalized()
    pose = Matrix((right, back.cross(right), back)).transposed().to_4x4()
    pose.translation = eye
    data = bpy.data.cameras.new(item.name)
    data.sensor_fit, data.angle_y = "VERTICAL", view.camera_fov
    data.clip_start, data.clip_end = 0.001 * (eye - target).length, 1000 * (eye - target).length
    camera = bpy.data.objects.new(item.name + " camera", data)
    camera.matrix_world = item.matrix_world @ pose
    camera.scale = (1, 1, 1)
    context.collection.objects.link(camera)
    context.scene.camera = camera

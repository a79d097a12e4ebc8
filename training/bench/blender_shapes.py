# SPDX-License-Identifier: Apache-2.0
"""Materials, shapes and lights that the scenes of blender_capture.py are made of."""

import bpy
from mathutils import Vector


def material(name, color, roughness=0.6, metallic=0.0, transmission=0.0):
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    shader = made.node_tree.nodes["Principled BSDF"]
    shader.inputs["Base Color"].default_value = (*color, 1)
    shader.inputs["Roughness"].default_value = roughness
    shader.inputs["Metallic"].default_value = metallic
    shader.inputs["Transmission"].default_value = transmission
    return made


def checkered(name, first, second, scale):
    made = material(name, first)
    nodes, links = made.node_tree.nodes, made.node_tree.links
    checker = nodes.new("ShaderNodeTexChecker")
    checker.inputs["Color1"].default_value = (*first, 1)
    checker.inputs["Color2"].default_value = (*second, 1)
    checker.inputs["Scale"].default_value = scale
    links.new(checker.outputs["Color"], nodes["Principled BSDF"].inputs["Base Color"])
    return made


def last_object(paint, parent=None):
    made = bpy.context.object
    made.data.materials.append(paint)
    made.parent = parent
    return made


def rod(begin, end, radius, paint, parent=None):
    """A thin cylinder between two points."""
    begin, end = Vector(begin), Vector(end)
    along = end - begin
    bpy.ops.mesh.primitive_cylinder_add(vertices=8, radius=radius, depth=along.length,
                                        location=(begin + end) / 2)
    made = last_object(paint, parent)
    made.rotation_mode = "QUATERNION"
    made.rotation_quaternion = along.to_track_quat("Z", "Y")
    return made


def ball(place, radius, paint):
    bpy.ops.mesh.primitive_uv_sphere_add(segments=48, ring_count=24, radius=radius, location=place)
    bpy.ops.object.shade_smooth()
    return last_object(paint)


def empty(place):
    made = bpy.data.objects.new("empty", None)
    made.location = place
    bpy.context.collection.objects.link(made)
    return made


def tinted(kind, paint, parent=None, **options):
    """A primitive of Blender ("cube", "cylinder", "cone", "torus") in this material."""
    getattr(bpy.ops.mesh, f"primitive_{kind}_add")(**options)
    return last_object(paint, parent)


def box(place, size, paint, parent=None, turn=0.0):
    made = tinted("cube", paint, parent, size=1, location=place, rotation=(0, 0, turn))
    made.scale = size
    return made


def area_light(place, target, energy, size):
    bpy.ops.object.light_add(type="AREA", location=place)
    light = bpy.context.object
    light.data.energy, light.data.size = energy, size
    light.rotation_euler = (target - light.location).to_track_quat("-Z", "Y").to_euler()


def sky(color, strength):
    world = bpy.context.scene.world
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (*color, 1)
    world.node_tree.nodes["Background"].inputs["Strength"].default_value = strength

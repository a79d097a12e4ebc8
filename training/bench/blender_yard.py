# SPDX-License-Identifier: Apache-2.0
"""The scene `yard` of blender_capture.py: what cameras need that nobody has placed or synchronised.

A ground and blocks with spots of which no two are alike, walls behind them, and things that move by
starts: balls that jump, some at once, and a cart that halts. By the first, programs like COLMAP find
the places of cameras, by the second, `l4dtrain sync` finds their clocks.
"""

import math
import random

import bpy
from blender_shapes import area_light, ball, box, checkered, empty, material, sky, tinted
from mathutils import Vector

RADIUS = 5.3  # of the cameras around the scene, m
CENTRE = Vector((0, 0, 0.35))
FIELD = math.radians(55)  # of view, horizontally
HEIGHTS = (18, 30, 42)  # of cameras above the horizon, degrees
BOUNCES = 2  # of light at most
NOISE = "image"  # equal noise in two images would be taken for something that both cameras see
IS_CLEAR = False  # without a background, so that images have alpha


def spotted(name, color):
    """Spots of 5 to 20 cm, by where they are in the world."""
    made = material(name, color)
    nodes, links = made.node_tree.nodes, made.node_tree.links
    place, color_node = nodes.new("ShaderNodeNewGeometry"), nodes.new("ShaderNodeRGB")
    color_node.outputs["Color"].default_value = (*color, 1)
    painted = color_node.outputs["Color"]
    for texture, scale in (("ShaderNodeTexVoronoi", 5), ("ShaderNodeTexNoise", 9)):
        spots, mix = nodes.new(texture), nodes.new("ShaderNodeMixRGB")
        spots.inputs["Scale"].default_value = scale  # spots of so many a metre
        mix.blend_type = "OVERLAY"
        mix.inputs["Fac"].default_value = 0.8
        links.new(place.outputs["Position"], spots.inputs["Vector"])
        links.new(painted, mix.inputs["Color1"])
        links.new(spots.outputs["Color"], mix.inputs["Color2"])
        painted = mix.outputs["Color"]
    links.new(painted, nodes["Principled BSDF"].inputs["Base Color"])
    return made


def still_things():
    draw = random.Random(1)
    bpy.ops.mesh.primitive_plane_add(size=24)
    bpy.context.object.data.materials.append(spotted("ground", (0.45, 0.42, 0.36)))
    paints = [spotted(f"block {k}", [draw.uniform(0.2, 0.7) for _ in range(3)]) for k in range(6)]
    for k in range(36):
        angle, away = draw.uniform(0, 2 * math.pi), draw.uniform(0.7, 3.4)
        size = [draw.uniform(0.2, 0.5) for _ in range(2)] + [draw.uniform(0.15, 0.9)]
        place = (away * math.cos(angle), away * math.sin(angle), size[2] / 2)
        if abs(place[1] - 0.2) > 0.5:  # where the cart does not go
            box(place, size, paints[k % 6], turn=draw.uniform(0, math.pi))
    for k in range(14):
        angle = 2 * math.pi * k / 14
        height = draw.uniform(0.8, 2)
        box((6 * math.cos(angle), 6 * math.sin(angle), height / 2), (0.2, 2, height),
            paints[k % 6], turn=angle)


def cart():
    made = empty((0, 0, 0))
    box((0, 0, 0.28), (0.6, 0.36, 0.26), material("cart", (0.75, 0.06, 0.03), 0.4), made)
    box((-0.12, 0, 0.5), (0.3, 0.3, 0.2), material("cabin", (0.9, 0.8, 0.5)), made)
    for x in (-0.2, 0.2):
        for y in (-0.2, 0.2):
            tinted("cylinder", material("wheel", (0.04, 0.04, 0.05)), made, vertices=24, radius=0.1,
                   depth=0.05, location=(x, y, 0.1), rotation=(math.pi / 2, 0, 0))
    return made


def moving_things():
    """Returns functions of seconds that place what moves."""
    draw = random.Random(2)
    moments = [draw.uniform(0, 0.5)]
    while moments[-1] < 3600:
        moments.append(moments[-1] + draw.uniform(0.25, 1))
    balls = []
    for k in range(10):
        size, angle, away = draw.uniform(0.14, 0.22), math.pi * k / 5, draw.uniform(0.9, 2.4)
        place = Vector((away * math.cos(angle), away * math.sin(angle), size))
        paint = checkered(f"ball {k}", [draw.random() for _ in range(3)], (0.9, 0.9, 0.9), 5)
        balls.append((ball(place, size, paint), place, [m for m in moments if draw.random() < 0.4]))
    driven = cart()

    def jump(seconds):
        for made, place, begins in balls:
            since = seconds - max((b for b in begins if b <= seconds), default=-1)
            height = 16 * since * (0.5 - since) if since < 0.5 else 0
            made.location = place + Vector((0, 0, 0.6 * height))

    def drive(seconds):
        # Half a second to the next stop, and half a second there; at the end it turns back.
        stop, since = divmod(seconds, 1)
        at = stop + (0.5 - 0.5 * math.cos(math.pi * min(1, 2 * since)))
        driven.location = (-1.6 + 0.8 * abs((at + 4) % 8 - 4), 0.2, 0)

    return [jump, drive]


def lights():
    area_light((3, -3, 5), CENTRE, 420, 2.5)
    area_light((-4, 2, 4), CENTRE, 160, 3)
    sky((0.75, 0.85, 1), 0.55)

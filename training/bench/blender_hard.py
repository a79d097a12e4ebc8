# SPDX-License-Identifier: Apache-2.0
"""The scene `hard` of blender_capture.py: wires, spokes, fast balls, a mirror, chrome and glass."""

import math

import bpy
from blender_shapes import area_light, ball, checkered, empty, last_object, material, rod, sky
from mathutils import Vector

RADIUS = 4.2  # of the cameras around the scene, m
CENTRE = Vector((0, 0, 0.7))
FIELD = math.radians(48)  # of view, horizontally
HEIGHTS = (14, 30, 46)  # of cameras above the horizon, degrees
BOUNCES = 6  # of light at most
NOISE = "none"  # moves: frames have the same
IS_CLEAR = False  # without a background, so that images have alpha


def still_things():
    bpy.ops.mesh.primitive_plane_add(size=9)
    last_object(checkered("floor", (0.62, 0.58, 0.5), (0.2, 0.24, 0.28), 18))
    steel = material("steel", (0.55, 0.57, 0.6), 0.35, 0.9)
    # A fence of wires, and three stalks that cross each other.
    for k in range(13):
        x = -1.5 + 0.25 * k
        rod((x, -1.3, 0), (x, -1.3, 1.1), 0.006, steel)
    for k in range(4):
        rod((-1.5, -1.3, 0.2 + 0.3 * k), (1.5, -1.3, 0.2 + 0.3 * k), 0.004, steel)
    for k in range(3):
        angle = 2 * math.pi * k / 3
        rod((1.3 + 0.3 * math.cos(angle), 0.9 + 0.3 * math.sin(angle), 0),
            (1.3 - 0.3 * math.cos(angle), 0.9 - 0.3 * math.sin(angle), 1.5), 0.008,
            material(f"stalk {k}", ((0.8, 0.2, 0.1), (0.1, 0.5, 0.2), (0.1, 0.25, 0.8))[k]))
    # A mirror that leans, a chromed ball, and one of glass.
    bpy.ops.mesh.primitive_cube_add(size=1, location=(-1.25, 1.1, 0.75),
                                    rotation=(0.12, 0, math.radians(38)))
    last_object(material("mirror", (0.9, 0.92, 0.92), 0.02, 1)).scale = (1.1, 0.03, 1.4)
    ball((0.95, -0.35, 0.32), 0.32, material("chrome", (0.9, 0.9, 0.9), 0.04, 1))
    ball((-0.85, -0.45, 0.28), 0.28, material("glass", (0.9, 0.97, 0.95), 0.0, 0, 1))


def moving_things():
    """Returns functions of seconds that place what moves."""
    wheel = empty((0, 0.35, 0.85))
    rubber = material("rubber", (0.05, 0.05, 0.06))
    spoke = material("spoke", (0.8, 0.75, 0.5), 0.3, 0.8)
    bpy.ops.mesh.primitive_torus_add(major_radius=0.55, minor_radius=0.03, major_segments=64,
                                     rotation=(math.pi / 2, 0, 0))
    last_object(rubber, wheel)
    for k in range(12):
        angle = 2 * math.pi * k / 12
        rod((0, 0, 0), (0.55 * math.cos(angle), 0, 0.55 * math.sin(angle)), 0.007, spoke, wheel)
    rod((0, 0.35, 0), (0, 0.35, 0.85), 0.02, rubber)
    bouncing = ball((0, 0, 0), 0.14, checkered("ball", (0.9, 0.35, 0.05), (0.95, 0.9, 0.8), 6))
    circling = ball((0, 0, 0), 0.09, material("circling", (0.15, 0.3, 0.9), 0.2))

    def turn(seconds):
        wheel.rotation_euler = (0, 4 * math.pi * seconds, 0)

    def bounce(seconds):
        there = (seconds / 1.2) % 2
        across = there if there < 1 else 2 - there
        height = abs(math.sin(2 * math.pi * seconds / 0.8))
        bouncing.location = (-1.6 + 3.2 * across, -0.8, 0.14 + 0.9 * height)
        bouncing.rotation_euler = (0, 7 * seconds, 3 * seconds)

    def circle(seconds):
        angle = 2 * math.pi * seconds / 1.5
        circling.location = (1.35 * math.cos(angle), 0.2 + 1.15 * math.sin(angle),
                             0.95 + 0.35 * math.sin(2 * angle))

    return [turn, bounce, circle]


def lights():
    for place, energy, size in (((2.5, -2.5, 4), 260, 1.2), ((-3, 1, 3.5), 130, 2)):
        area_light(place, CENTRE, energy, size)
    sky((0.5, 0.62, 0.75), 0.5)

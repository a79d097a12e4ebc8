# SPDX-License-Identifier: Apache-2.0
"""The scene `railway` of blender_capture.py: a toy train circles a hill with a mill and a house.

Everything comes back to where it began after LAP seconds, so that the scene plays in a loop.
"""

import math

from blender_shapes import area_light, ball, box, empty, material, rod, sky, tinted
from mathutils import Vector

RADIUS = 5.3  # of the cameras around the scene, m
CENTRE = Vector((0, 0, 0.15))
FIELD = math.radians(48)  # of view, horizontally
HEIGHTS = (16, 30, 44)  # of cameras above the horizon, degrees
BOUNCES = 2  # of light at most
NOISE = "frame"  # each has noise of its own, which a training averages
IS_CLEAR = True  # without a background, so that images have alpha

LAP = 4.0  # s
TRACK = 1.45  # radius, m
PUFFS = 6  # of steam, on their way at once


def wood():
    return material("wood", (0.42, 0.23, 0.1), 0.5)


def on_circle(angle, radius, height=0.0):
    return Vector((radius * math.cos(angle), radius * math.sin(angle), height))


def tree(place, height, green):
    place = Vector(place)
    rod(place, place + Vector((0, 0, 0.35 * height)), 0.045, wood())
    for k in range(3):
        tinted("cone", green, vertices=24, radius1=0.24 - 0.06 * k, depth=0.5 * height,
               location=place + Vector((0, 0, (0.45 + 0.22 * k) * height)))


def house(place, turn):
    made = empty(place)
    made.rotation_euler = (0, 0, turn)
    box((0, 0, 0.17), (0.5, 0.38, 0.34), material("wall", (0.9, 0.82, 0.62)), made)
    red = material("roof", (0.62, 0.12, 0.06))
    roof = tinted("cylinder", red, made, vertices=3, radius=0.3, depth=0.58, location=(0, 0, 0.42),
                  rotation=(0, math.pi / 2, 0))
    roof.scale = (0.8, 1, 1)
    box((0.14, 0.1, 0.58), (0.09, 0.09, 0.24), material("bricks", (0.45, 0.2, 0.14)), made)
    dark = material("window", (0.08, 0.13, 0.25), 0.2)
    for x in (-0.14, 0.14):
        box((x, -0.19, 0.2), (0.1, 0.02, 0.12), dark, made)
    box((0, -0.19, 0.1), (0.1, 0.02, 0.2), wood(), made)


def still_things():
    tinted("cylinder", wood(), vertices=96, radius=1.95, depth=0.16, location=(0, 0, -0.11))
    tinted("cylinder", material("grass", (0.16, 0.36, 0.08), 0.9), vertices=96, radius=1.88,
           depth=0.06, location=(0, 0, -0.025))
    tinted("cylinder", material("gravel", (0.5, 0.46, 0.4), 0.9), vertices=96, radius=TRACK + 0.2,
           depth=0.04, location=(0, 0, -0.01))
    tinted("cylinder", material("meadow", (0.2, 0.42, 0.1), 0.9), vertices=96, radius=TRACK - 0.2,
           depth=0.06, location=(0, 0, -0.01))
    steel = material("steel", (0.5, 0.5, 0.53), 0.4, 0.6)
    for side in (-0.09, 0.09):
        tinted("torus", steel, major_radius=TRACK + side, minor_radius=0.018, major_segments=96,
               minor_segments=8, location=(0, 0, 0.045))
    for k in range(48):
        angle = 2 * math.pi * k / 48
        box(on_circle(angle, TRACK, 0.018), (0.32, 0.07, 0.03), wood(), turn=angle)
    ball((0.1, 0.15, 0), 0.7, material("hill", (0.22, 0.45, 0.11), 0.9)).scale = (1, 1, 0.6)
    house((-0.68, -0.5, 0.02), 0.6)
    green = material("fir", (0.05, 0.24, 0.09), 0.8)
    for x, y, height in ((0.75, -0.6, 0.85), (0.35, -0.85, 0.65), (-0.85, 0.35, 0.8),
                         (-0.45, 0.85, 0.7), (0.85, 0.5, 0.75)):
        tree((x, y, 0.01), height, green)


def windmill():
    """Returns the empty that carries the sails."""
    tinted("cone", material("mill", (0.92, 0.9, 0.84)), vertices=32, radius1=0.26, radius2=0.17,
           depth=0.75, location=(0.1, 0.15, 0.75))
    tinted("cone", material("cap", (0.55, 0.14, 0.08)), vertices=32, radius1=0.22, depth=0.22,
           location=(0.1, 0.15, 1.23))
    box((0.1, -0.13, 0.55), (0.12, 0.06, 0.24), wood())
    axle = empty((0.1, -0.12, 1.05))
    ball((0, 0, 0), 0.05, wood()).parent = axle
    cloth = material("cloth", (0.95, 0.93, 0.85))
    for k in range(4):
        arm = empty((0, 0, 0))
        arm.parent, arm.rotation_euler = axle, (0, math.pi / 2 * k, 0)
        rod((0, 0, 0), (0, 0, 0.62), 0.016, wood(), arm)
        box((0.075, 0, 0.38), (0.13, 0.015, 0.44), cloth, arm)
    return axle


def wheels(car, length, radius):
    dark = material("wheel", (0.04, 0.04, 0.05))
    for x in (-0.3 * length, 0, 0.3 * length):
        for y in (-0.1, 0.1):
            tinted("cylinder", dark, car, vertices=24, radius=radius, depth=0.035,
                   location=(x, y, 0.06 + radius), rotation=(math.pi / 2, 0, 0))


def engine():
    """A steam engine that looks along +x."""
    made = empty((0, 0, 0))
    red = material("red", (0.75, 0.04, 0.03), 0.35)
    black = material("black", (0.03, 0.03, 0.035), 0.4)
    gold = material("gold", (0.95, 0.6, 0.08), 0.3)
    box((0, 0, 0.17), (0.6, 0.22, 0.06), black, made)
    tinted("cylinder", red, made, vertices=32, radius=0.12, depth=0.4, location=(0.1, 0, 0.31),
           rotation=(0, math.pi / 2, 0))
    tinted("cylinder", black, made, vertices=32, radius=0.125, depth=0.05, location=(0.31, 0, 0.31),
           rotation=(0, math.pi / 2, 0))
    for x in (0, 0.18):
        tinted("cylinder", gold, made, vertices=32, radius=0.125, depth=0.025,
               location=(x, 0, 0.31), rotation=(0, math.pi / 2, 0))
    box((-0.19, 0, 0.34), (0.2, 0.25, 0.3), red, made)
    box((-0.19, 0, 0.51), (0.27, 0.3, 0.04), black, made)
    box((-0.19, 0, 0.4), (0.12, 0.26, 0.1), material("pane", (0.35, 0.6, 0.75), 0.2), made)
    tinted("cone", black, made, vertices=24, radius1=0.035, radius2=0.07, depth=0.22,
           location=(0.22, 0, 0.5))
    ball((0.04, 0, 0.44), 0.05, gold).parent = made
    wheels(made, 0.6, 0.075)
    return made


def wagon(color, load):
    made = empty((0, 0, 0))
    box((0, 0, 0.23), (0.46, 0.24, 0.16), material("wagon", color, 0.4), made)
    box((0.29, 0, 0.17), (0.14, 0.05, 0.03), material("coupling", (0.1, 0.1, 0.1)), made)
    for k in range(3):
        ball((-0.14 + 0.14 * k, 0, 0.33), 0.085, material("load", load)).parent = made
    wheels(made, 0.46, 0.06)
    return made


def moving_things():
    """Returns functions of seconds that place what moves."""
    train = [engine(), wagon((0.05, 0.2, 0.7), (0.95, 0.75, 0.1)),
             wagon((0.95, 0.6, 0.03), (0.6, 0.1, 0.08)),
             wagon((0.06, 0.45, 0.15), (0.85, 0.85, 0.8))]
    axle = windmill()
    steam = material("steam", (0.95, 0.95, 0.97), 1)
    puffs = [ball((0, 0, 0), 1, steam) for _ in range(PUFFS)]

    def head(seconds):
        return 2 * math.pi * seconds / LAP

    def drive(seconds):
        for k, car in enumerate(train):
            angle = head(seconds) - (0.42 * k + (0.03 if k else 0))
            car.location = on_circle(angle, TRACK)
            car.rotation_euler = (0, 0, angle + math.pi / 2)

    def turn(seconds):
        axle.rotation_euler = (0, math.pi * seconds / LAP, 0)

    def smoke(seconds):
        # A puff leaves the chimney, rises where it is, grows, and shrinks to nothing.
        every = LAP / 20
        for k, puff in enumerate(puffs):
            born = every * (math.floor(seconds / every) - k)
            age = (seconds - born) / (every * PUFFS)
            puff.location = on_circle(head(born) + 0.15, TRACK, 0.66 + 0.5 * age)
            puff.scale = [max(1e-3, 0.12 * math.sin(math.pi * min(1, 0.15 + 0.85 * age)))] * 3

    return [drive, turn, smoke]


def lights():
    area_light((3, -3, 5), CENTRE, 420, 2.5)
    area_light((-4, 2, 4), CENTRE, 160, 3)
    sky((0.75, 0.85, 1), 0.55)

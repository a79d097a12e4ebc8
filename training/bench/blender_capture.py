# SPDX-License-Identifier: Apache-2.0
"""Renders a capture of hard content whose cameras are known exactly, with Blender (3.4 or later).

usage: blender --background --factory-startup --python training/bench/blender_capture.py -- FOLDER
               [--size 1024x768] [--cameras 20] [--frames 300] [--fps 30] [--samples 64] [--threads N]

FOLDER becomes a capture for `l4dtrain train FOLDER`: cameras.json and images/camNN/%04d.png. The
scene has what captures of people lack or hide: wires and spokes that are thinner than a pixel of
small images, a wheel that turns twice a second, a ball that bounces through the scene and one that
circles it, a mirror, a chromed ball and glass. Cycles renders on the processor, without motion
blur. Equal options give equal images on one version of Blender and kind of machine. Images that are
there already stay, so that a rendering which was interrupted goes on.

Blender is not installed by `./dev setup`: on Debian, `apt-get install blender`.
"""

import argparse
import json
import math
import pathlib
import sys

import bpy
from mathutils import Vector

TEST_EVERY = 8  # cameras
RADIUS = 4.2  # of the cameras around the scene, m
CENTRE = Vector((0, 0, 0.7))
FIELD = math.radians(48)  # of view, horizontally


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
        bpy.ops.object.light_add(type="AREA", location=place)
        light = bpy.context.object
        light.data.energy, light.data.size = energy, size
        light.rotation_euler = (CENTRE - light.location).to_track_quat("-Z", "Y").to_euler()
    world = bpy.context.scene.world
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.5, 0.62, 0.75, 1)
    world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0.5


def make_cameras(count):
    """Cameras on three rings that look at the centre, no two in one direction."""
    made = []
    for k in range(count):
        angle = 2 * math.pi * k / count
        up = math.radians((14, 30, 46)[k % 3])
        place = CENTRE + RADIUS * Vector((math.cos(angle) * math.cos(up),
                                          math.sin(angle) * math.cos(up), math.sin(up)))
        bpy.ops.object.camera_add(location=place)
        camera = bpy.context.object
        camera.rotation_euler = (CENTRE - place).to_track_quat("-Z", "Y").to_euler()
        camera.data.sensor_fit, camera.data.angle = "HORIZONTAL", FIELD
        camera.data.clip_start = 0.05
        made.append(camera)
    bpy.context.view_layer.update()
    return made


def describe(index, camera, width, height):
    """The camera as cameras.json has it: OpenCV axes, y down and z ahead."""
    w2c = camera.matrix_world.inverted()
    rows = [[sign * w2c[r][c] for c in range(4)] for r, sign in ((0, 1), (1, -1), (2, -1))]
    focal = width / 2 / math.tan(camera.data.angle_x / 2)
    return {"id": index, "split": "test" if index % TEST_EVERY == 0 else "train",
            "K": [[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]],
            "w2c": [*rows, [0, 0, 0, 1]], "images": f"images/cam{index:02d}/%04d.png"}


def set_up_rendering(options):
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.samples, scene.cycles.seed = options.samples, 0
    scene.cycles.use_adaptive_sampling = scene.cycles.use_denoising = False
    scene.cycles.max_bounces, scene.cycles.sample_clamp_indirect = 6, 3
    scene.render.resolution_x, scene.render.resolution_y = options.width, options.height
    scene.render.resolution_percentage = 100
    scene.render.use_motion_blur = False
    scene.render.use_persistent_data = True
    scene.render.image_settings.file_format = "PNG"
    scene.render.image_settings.color_mode = "RGB"
    scene.render.image_settings.color_depth = "8"
    scene.view_settings.view_transform = "Standard"
    if options.threads:
        scene.render.threads_mode, scene.render.threads = "FIXED", options.threads
    return scene


def without_text(png):
    """The PNG without its text, which says when it was made and how long that took."""
    out, at = png[:8], 8
    while at < len(png):
        size = 12 + int.from_bytes(png[at:at + 4], "big")
        if png[at + 4:at + 8] != b"tEXt":
            out += png[at:at + size]
        at += size
    return out


def arguments():
    parser = argparse.ArgumentParser(prog="blender_capture.py")
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--size", default="1024x768")
    parser.add_argument("--cameras", type=int, default=20)
    parser.add_argument("--frames", type=int, default=300)
    parser.add_argument("--fps", type=float, default=30)
    parser.add_argument("--samples", type=int, default=64, help="rays of a pixel")
    parser.add_argument("--threads", type=int, default=0, help="0: one per core")
    own = sys.argv[sys.argv.index("--") + 1:] if "--" in sys.argv else []
    options = parser.parse_args(own)
    try:
        options.width, options.height = (int(n) for n in options.size.split("x"))
    except ValueError:
        parser.error(f"--size is {options.size}; it must be like 1024x768")
    if min(options.width, options.height, options.cameras, options.frames, options.samples) < 1:
        parser.error("sizes and counts must be 1 or more")
    return options


def main():
    options = arguments()
    bpy.ops.object.select_all(action="SELECT")
    bpy.ops.object.delete()
    scene = set_up_rendering(options)
    still_things()
    movements = moving_things()
    lights()
    cameras = make_cameras(options.cameras)
    folder = options.folder.resolve()
    for frame in range(options.frames):
        for place in movements:
            place(frame / options.fps)
        for index, camera in enumerate(cameras):
            path = folder / f"images/cam{index:02d}/{frame:04d}.png"
            if path.exists():
                continue
            scene.camera = camera
            # Blender adds .png; what is not whole yet has another name.
            scene.render.filepath = str(path.with_name(f"new-{frame:04d}.png"))
            bpy.ops.render.render(write_still=True)
            made = path.with_name(f"new-{frame:04d}.png")
            made.write_bytes(without_text(made.read_bytes()))
            made.rename(path)
    document = {"fps": options.fps, "frames": options.frames, "width": options.width,
                "height": options.height,
                "cameras": [describe(index, camera, options.width, options.height)
                            for index, camera in enumerate(cameras)]}
    (folder / "cameras.json").write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")


try:
    main()
except SystemExit:
    raise
except Exception as error:  # pylint: disable=broad-except
    # Blender itself ends with status 0 after an error of a script.
    print(f"blender_capture.py: {error}", file=sys.stderr)
    sys.exit(1)

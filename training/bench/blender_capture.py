# SPDX-License-Identifier: Apache-2.0
"""Renders a capture whose cameras are known exactly, with Blender (3.4 or later).

usage: blender --background --factory-startup --python training/bench/blender_capture.py -- FOLDER
               [--scene hard] [--size 1024x768] [--cameras 20] [--arc 360] [--heights H ...]
               [--frames 300] [--fps 30] [--samples 64] [--threads N] [--points N]

FOLDER becomes a capture for `l4dtrain train FOLDER`: cameras.json and images/camNN/%04d.png. The
scene `hard` has what captures of people lack or hide: wires and spokes that are thinner than a
pixel of small images, a wheel that turns twice a second, a ball that bounces through the scene and
one that circles it, a mirror, a chromed ball and glass. The scene `railway` is a toy for the
gallery of `./dev web --site --blender`: a train circles a hill, a mill turns; it comes back to
where it began after 4 s, and its images have alpha. `--points` also writes points.ply, so many
points of each frame, for `l4dtrain train --init`.
The scene `yard` is for footage
without places and clocks: blocks of which no two are alike, balls that jump, a cart that halts.
Cycles renders on the processor, without motion blur. Equal options give equal images on one version
of Blender and kind of machine. Images that are there already stay, so that a rendering which was
interrupted goes on.

`./dev setup blender` installs Blender on Debian and Ubuntu.
"""

import argparse
import importlib
import json
import math
import pathlib
import sys

import bpy
from mathutils import Vector

# Blender does not look for modules next to a script, and compiled ones do not belong there.
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
sys.dont_write_bytecode = True
from blender_points import Points  # noqa: E402

TEST_EVERY = 8  # cameras


def make_cameras(count, arc, heights, chosen):
    """Cameras on rings, or so many degrees of them, that look at the centre of the scene."""
    made = []
    for k in range(count):
        angle = math.radians(arc) * k / count
        up = math.radians(heights[k % len(heights)])
        away = Vector((math.cos(angle) * math.cos(up), math.sin(angle) * math.cos(up),
                       math.sin(up)))
        place = chosen.CENTRE + chosen.RADIUS * away
        bpy.ops.object.camera_add(location=place)
        camera = bpy.context.object
        camera.rotation_euler = (chosen.CENTRE - place).to_track_quat("-Z", "Y").to_euler()
        camera.data.sensor_fit, camera.data.angle = "HORIZONTAL", chosen.FIELD
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


def set_up_rendering(options, chosen):
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.samples = options.samples
    scene.cycles.use_adaptive_sampling = scene.cycles.use_denoising = False
    scene.cycles.max_bounces, scene.cycles.sample_clamp_indirect = chosen.BOUNCES, 3
    scene.render.resolution_x, scene.render.resolution_y = options.width, options.height
    scene.render.resolution_percentage = 100
    scene.render.use_motion_blur = False
    scene.render.film_transparent = chosen.IS_CLEAR
    scene.render.use_persistent_data = True
    scene.render.image_settings.file_format = "PNG"
    scene.render.image_settings.color_mode = "RGBA" if chosen.IS_CLEAR else "RGB"
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
    parser.add_argument("--scene", default="hard", choices=("hard", "railway", "yard"))
    parser.add_argument("--size", default="1024x768")
    parser.add_argument("--cameras", type=int, default=20)
    parser.add_argument("--arc", type=float, default=360, help="degrees around the scene")
    parser.add_argument("--heights", type=float, nargs="+",
                        help="of cameras above the horizon, degrees, in turn")
    parser.add_argument("--frames", type=int, default=300)
    parser.add_argument("--fps", type=float, default=30)
    parser.add_argument("--samples", type=int, default=64, help="rays of a pixel")
    parser.add_argument("--threads", type=int, default=0, help="0: one per core")
    parser.add_argument("--points", type=int, default=0,
                        help="points of each frame in points.ply, on what training cameras see")
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
    chosen = importlib.import_module(f"blender_{options.scene}")
    scene = set_up_rendering(options, chosen)
    chosen.still_things()
    still = set(bpy.data.objects)
    movements = chosen.moving_things()
    moving = set(bpy.data.objects) - still
    chosen.lights()
    cameras = make_cameras(options.cameras, options.arc, options.heights or chosen.HEIGHTS,
                           chosen)
    folder = options.folder.resolve()
    points = Points([c for k, c in enumerate(cameras) if k % TEST_EVERY != 0],
                    options.width / options.height, moving)
    for frame in range(options.frames):
        for place in movements:
            place(frame / options.fps)
        points.add(options.points, frame / options.fps)
        for index, camera in enumerate(cameras):
            path = folder / f"images/cam{index:02d}/{frame:04d}.png"
            if path.exists():
                continue
            scene.camera = camera
            scene.cycles.seed = {"none": 0, "frame": frame,
                                 "image": frame * len(cameras) + index}[chosen.NOISE]
            # Blender adds .png; what is not whole yet has another name.
            scene.render.filepath = str(path.with_name(f"new-{frame:04d}.png"))
            bpy.ops.render.render(write_still=True)
            made = path.with_name(f"new-{frame:04d}.png")
            made.write_bytes(without_text(made.read_bytes()))
            made.rename(path)
    if options.points:
        points.write(folder / "points.ply")
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

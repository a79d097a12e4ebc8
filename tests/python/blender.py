# SPDX-License-Identifier: Apache-2.0
"""The add-on in Blender without a window: blender -b --python blender.py -- ADDONS FOLDER.

ADDONS: l4d_import.zip, or the folder that has l4d_import. FOLDER, by its whole path: scene.ply, scene.l4d, lossless.l4d,
and frames, a folder of PLYs; run.sh makes them. Ends with status 1 at what is not as it should be.
"""

import io
import pathlib
import sys
import traceback
import warnings

import bpy
import numpy as np
from mathutils import Euler, Quaternion

addons, folder = sys.argv[sys.argv.index("--") + 1:]
stream_path, scene_path, frame_path = (folder + name for name in ("/scene.l4d", "/scene.ply", "/frames"))
sys.path.insert(0, addons)
sys.dont_write_bytecode = True

import l4d_import  # noqa: E402
import l4dcodec  # noqa: E402


def empty() -> None:
    bpy.ops.wm.read_factory_settings(use_empty=True)


def attribute(mesh, name, width):
    data = mesh.attributes[name].data
    field = {"FLOAT": "value", "FLOAT_VECTOR": "vector", "FLOAT_COLOR": "color", "QUATERNION": "value"}[
        mesh.attributes[name].data_type]
    out = np.empty(len(data) * width, np.float32)
    data.foreach_get(field, out)
    return out.reshape(-1, width)


def positions(mesh):
    out = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", out)
    return out.reshape(-1, 3)


def linear(rgb):
    rgb = np.clip(rgb, 0, 1)
    return np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)


def test_frames_are_the_slices() -> None:
    empty()
    assert bpy.ops.import_scene.l4d(filepath=stream_path) == {"FINISHED"}
    scene, item = bpy.context.scene, bpy.context.object
    stream = l4dcodec.open(stream_path)
    assert (scene.frame_start, scene.frame_end) == (1, stream.timeline.num_frames)
    assert abs(scene.render.fps / scene.render.fps_base - float(stream.timeline.fps)) < 1e-6
    for frame in (1, 20, 47, 20):
        scene.frame_set(frame)
        splats = stream.slice((frame - 1) / float(stream.timeline.fps))
        mesh = item.data
        assert len(mesh.vertices) == len(splats) > 100
        assert np.array_equal(positions(mesh), splats.means)
        assert np.array_equal(attribute(mesh, "scale", 3), splats.scales)
        assert np.array_equal(attribute(mesh, "quaternion", 4), splats.quats)
        assert np.array_equal(attribute(mesh, "opacity", 1)[:, 0], splats.opacities)
        color = attribute(mesh, "color", 4)
        assert np.abs(color[:, :3] - linear(0.5 + 0.28209479 * splats.sh[:, 0])).max() < 1e-5
        for angles, quaternion in zip(attribute(mesh, "rotation", 3), splats.quats):
            same = Euler(angles).to_quaternion().dot(Quaternion(quaternion))
            assert abs(abs(same) - 1) < 1e-5, (angles, quaternion)
        # Half a turn or a quarter of one: bounds stay bounds.
        world = positions(mesh) @ np.array(item.matrix_world.to_3x3()).T
        ends = np.stack([splats.means.min(0), splats.means.max(0)])
        up = {"Y": [0, -2, 1], "-Y": [0, 2, -1], "Z": [0, 1, 2]}[l4d_import.arrays.Stream([stream_path]).up()]
        expected = np.sort(np.stack([np.copysign(1, axis) * ends[:, abs(axis)] for axis in up], 1), 0)
        assert np.allclose([world.min(0), world.max(0)], expected, atol=1e-5)
    # A node for each Gaussian: ellipsoids where they are asked for.
    item.modifiers["Splats"][next(iter(switch_of(item)))] = True
    item.data.update()
    instances = sum(i.is_instance for i in bpy.context.evaluated_depsgraph_get().object_instances)
    assert instances == len(item.data.vertices)


def switch_of(item):
    return [socket.identifier for socket in item.modifiers["Splats"].node_group.inputs
            if socket.name == "Ellipsoids in Viewport"]


def test_colors_from_the_camera() -> None:
    empty()
    bpy.ops.import_scene.l4d(filepath=stream_path, from_camera=True)
    scene, item = bpy.context.scene, bpy.context.object
    stream = l4dcodec.open(stream_path)
    scene.frame_set(20)
    splats = stream.slice(19 / float(stream.timeline.fps),
                          camera_position=stream.info.presentation.camera_position)
    color = attribute(item.data, "color", 4)
    assert np.abs(color[:, :3] - linear(splats.colors)).max() < 1e-3
    item.l4d.from_camera = False
    assert np.abs(attribute(item.data, "color", 4) - color).max() > 0.01


def test_other_formats_and_sequences() -> None:
    empty()
    bpy.ops.import_scene.l4d(filepath=scene_path)
    bpy.context.scene.frame_set(20)
    exact = l4dcodec.open(folder + "/lossless.l4d").slice(19 / 30)
    mesh = bpy.context.object.data
    assert len(mesh.vertices) == len(exact)
    assert np.allclose(np.sort(positions(mesh), 0), np.sort(exact.means, 0), atol=1e-6)
    frames = sorted(pathlib.Path(frame_path).glob("f_*.ply"))
    bpy.ops.import_scene.l4d(filepath=str(frames[0]), directory=frame_path, files=[{"name": f.name} for f in frames],
                             fps=30)
    mesh, data = bpy.context.object.data, io.BytesIO()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        l4dcodec.encode(l4dcodec.read_frames(frames, fps=30), data, preset="lossless")
    sequence = l4dcodec.open(data.getvalue())
    assert bpy.context.scene.frame_end == len(frames) > 3
    for frame in (1, 3, len(frames)):
        bpy.context.scene.frame_set(frame)
        assert np.array_equal(positions(mesh), sequence.slice((frame - 1) / 30).means), frame


def test_what_is_no_scene_is_refused() -> None:
    empty()
    bad = pathlib.Path(folder) / "bad.l4d"
    bad.write_bytes(b"no scene at all")
    try:
        result = bpy.ops.import_scene.l4d(filepath=str(bad))
    except RuntimeError as error:
        assert "bad.l4d: NOT_L4D" in str(error), error
    else:
        raise AssertionError(result)
    assert not bpy.data.objects and not bpy.data.meshes


def render(path, size):
    """[height, width, 3] of a render at the present frame."""
    scene = bpy.context.scene
    scene.render.engine, scene.render.filepath = "CYCLES", path
    scene.cycles.device, scene.cycles.samples, scene.cycles.use_denoising = "CPU", 4, False
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = *size, 100
    scene.render.image_settings.file_format, scene.render.threads_mode = "PNG", "FIXED"
    scene.render.threads = 2
    bpy.ops.render.render(write_still=True)
    return loaded(path, size)


def loaded(path, size):
    image = bpy.data.images.load(path)
    pixels = np.array(image.pixels[:], np.float32).reshape(size[1], size[0], 4)[::-1]
    bpy.data.images.remove(image)
    return pixels[..., :3]


def test_pictures_show_the_scene() -> None:
    empty()
    bpy.ops.import_scene.l4d(filepath=stream_path, from_camera=True)
    scene, stream, size = bpy.context.scene, l4dcodec.open(stream_path), (80, 45)
    pictures = []
    for frame in (10, 50):
        scene.frame_set(frame)
        picture = render(f"{folder}/{frame}.png", size)
        camera = l4dcodec.Camera.suggested(stream.info.presentation, *size)
        expected = stream.render((frame - 1) / float(stream.timeline.fps), camera).clip(0, 1)
        # Rays meet ellipsoids in another order than the middles of these have, and light adds up in linear colours.
        alike = np.corrcoef(picture.ravel(), expected.ravel())[0, 1]
        print(f"frame {frame}: mean {picture.mean():.3f}, the library's {expected.mean():.3f}, correlation {alike:.3f}")
        assert picture.mean() > 0.02 and picture.std() > 0.02
        assert alike > 0.7
        pictures.append(picture)
    assert np.abs(pictures[0] - pictures[1]).mean() > 0.005
    # Frames of a rendered film are the same pictures.
    scene.frame_start, scene.frame_end, scene.frame_step, scene.render.filepath = 10, 50, 40, folder + "/film_"
    bpy.ops.render.render(animation=True)
    for frame, picture in zip((10, 50), pictures):
        assert np.array_equal(loaded(f"{folder}/film_{frame:04d}.png", size), picture)


def test_a_saved_file_shows_the_scene_again() -> None:
    empty()
    bpy.ops.import_scene.l4d(filepath=stream_path)
    name, path = bpy.context.object.name, folder + "/saved.blend"
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    bpy.context.scene.frame_set(30)
    stream = l4dcodec.open(stream_path)
    found = positions(bpy.data.objects[name].data)
    assert np.array_equal(found, stream.slice(29 / float(stream.timeline.fps)).means)
    l4d_import.unregister()
    assert not hasattr(bpy.types.Object, "l4d")


l4d_import.register()
try:
    for name_, test in list(globals().items()):
        if name_.startswith("test_"):
            test()
            print("passed:", name_, flush=True)
except BaseException:
    traceback.print_exc()
    sys.stdout.flush()
    sys.exit(1)

#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Frames a second of gsplat and of its inference renderer (HiGS), beside those of gpu_render_bench.

usage: peers.py SLICE.ply CAMERAS.json [--size WxH]... [--images FOLDER] [--frames 320]

SLICE.ply: what is visible at an instant (l4dcodec slice SCENE --time T -o SLICE.ply). CAMERAS.json:
as `l4dcodec cameras` makes it; the first 8 are looked from in turn, as gpu_render_bench does.
--images: renders of ours of these cameras at the first size, ID.png, to compare with.

Needs PyTorch, NumPy, Pillow and gsplat 1.6 or later, with its extensions built. Times are by events
on the device, frames without waiting for each other; medians. Black background, no antialiasing,
a dilation of 0.3, SH as the file has it.
"""
import argparse
import json
import pathlib
import statistics

import gsplat
import numpy as np
import torch
from PIL import Image

try:
    from gsplat.experimental import GaussianInferenceRenderer, GaussianInferenceScene
except ImportError:
    GaussianInferenceScene = None


def read_ply(path):
    """Means, quaternions wxyz, scales, opacities and SH [n, k, 3], on the device."""
    data = pathlib.Path(path).read_bytes()
    end = data.index(b"end_header\n") + len(b"end_header\n")
    lines = data[:end].decode().split("\n")
    names = [line.split()[-1] for line in lines if line.startswith("property float ")]
    rows = np.frombuffer(data, "<f4", offset=end).reshape(-1, len(names))
    column = {name: k for k, name in enumerate(names)}

    def take(*wanted):
        return torch.from_numpy(rows[:, [column[name] for name in wanted]].copy()).cuda()

    rest = sum(name.startswith("f_rest_") for name in names)
    sh = take("f_dc_0", "f_dc_1", "f_dc_2")[:, None]
    if rest:
        detail = take(*(f"f_rest_{k}" for k in range(rest))).reshape(-1, 3, rest // 3)
        sh = torch.cat([sh, detail.transpose(1, 2)], 1)
    return (take("x", "y", "z"), torch.nn.functional.normalize(take("rot_0", "rot_1", "rot_2", "rot_3"), dim=-1),
            take("scale_0", "scale_1", "scale_2").exp(), take("opacity")[:, 0].sigmoid(), sh.contiguous())


def read_cameras(path):
    document = json.loads(pathlib.Path(path).read_text())
    for camera in document["cameras"][:8]:
        width, height = (camera.get(key, document.get(key)) for key in ("width", "height"))
        yield camera["id"], width, height, np.array(camera["K"], float), np.array(camera["w2c"], float)


def at_size(camera, size):
    """K and w2c of a camera at another size, with its field of view upright."""
    _, width, height, k, w2c = camera
    k = k.copy()
    k[0, 2] *= size[0] / width
    k[:2, :2] *= size[1] / height
    k[1, 2] *= size[1] / height
    return [torch.from_numpy(m).float().cuda() for m in (k, w2c)]


def median_ms(draw, cameras, frames):
    for k in range(24):
        draw(*cameras[k % len(cameras)])
    events = [torch.cuda.Event(enable_timing=True) for _ in range(frames + 1)]
    events[0].record()
    for k in range(frames):
        draw(*cameras[k % len(cameras)])
        events[k + 1].record()
    torch.cuda.synchronize()
    return statistics.median(a.elapsed_time(b) for a, b in zip(events, events[1:]))


def renderers(splats, size):
    """Name and a function of K and w2c that returns an image."""
    means, rotations, scales, opacities, sh = splats
    degree = round(sh.shape[1] ** 0.5) - 1

    def plain(k, w2c):
        return gsplat.rasterization(means, rotations, scales, opacities, sh, w2c[None], k[None], *size,
                                    near_plane=0.02, sh_degree=degree, packed=False)[0][0]

    yield f"gsplat {gsplat.__version__}", plain
    for tile in (8, 16) if GaussianInferenceScene else ():
        scene = GaussianInferenceScene.from_gaussian_tensors(
            means, rotations, scales, opacities, sh, sh_degree=degree, sh_compression="none", id=f"{tile} {size}")
        renderer = GaussianInferenceRenderer(scene, tile_size=tile)

        def infer(k, w2c, renderer=renderer):
            return renderer.render(viewmat=w2c, K=k, width=size[0], height=size[1], near_plane=0.02,
                                   far_plane=1e10, radius_clip=0.0, eps2d=0.3).frame[0, :, :, :3]

        yield f"HiGS, tiles of {tile}", infer
        renderer.release()


def decibels(draw, cameras, ids, folder):
    """Of the worst view, both images as bytes."""
    worst = 0.0
    for name, camera in zip(ids, cameras):
        ours = np.asarray(Image.open(pathlib.Path(folder) / f"{name}.png").convert("RGB"), float) / 255
        theirs = draw(*camera).float().clamp(0, 1).cpu().numpy()
        worst = max(worst, float(((np.round(theirs * 255) / 255 - ours) ** 2).mean()))
    return -10 * np.log10(worst) if worst else float("inf")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("slice")
    parser.add_argument("cameras")
    parser.add_argument("--size", action="append", help="WxH (1352x1014 and 3840x2160)")
    parser.add_argument("--images")
    parser.add_argument("--frames", type=int, default=320)
    options = parser.parse_args()
    splats = read_ply(options.slice)
    all_cameras = list(read_cameras(options.cameras))
    print(f"{len(splats[0])} Gaussians, {torch.cuda.get_device_name()}\n")
    print("| renderer | pixels | frames/s | worst dB against ours |\n|---|---|---:|---:|")
    for index, text in enumerate(options.size or ["1352x1014", "3840x2160"]):
        size = tuple(int(side) for side in text.split("x"))
        cameras = [at_size(camera, size) for camera in all_cameras]
        for name, draw in renderers(splats, size):
            with torch.inference_mode():
                rate = 1e3 / median_ms(draw, cameras, options.frames)
                known = options.images and index == 0
                dB = f"{decibels(draw, cameras, [c[0] for c in all_cameras], options.images):.1f}" if known else ""
            print(f"| {name} | {text} | {rate:.0f} | {dB} |", flush=True)


if __name__ == "__main__":
    main()

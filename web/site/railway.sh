#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: railway.sh TRAINER OUT
# Renders a toy railway with Blender, from 14 cameras, in OUT/capture, trains a scene on 12 of them, and encodes it:
# OUT/run/scene.l4d. What is rendered already stays.
set -euo pipefail
trainer=$1 out=$2
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
mkdir -p "$out"
# Debian's Blender has no denoiser: many images with few rays each give the training as much light.
blender --background --factory-startup --python "$root/training/bench/blender_capture.py" -- "$out/capture" --scene railway \
  --size 320x240 --cameras 14 --frames 40 --fps 10 --samples 8 --points 900 >"$out/blender.log"
"$trainer" train "$out/capture" --init "$out/capture/points.ply" -o "$out/run" --force --steps 5000 --gaussians 40000 --sh-degree 0 \
  --views 1 --encode default

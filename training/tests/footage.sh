#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Videos as phones take them, without places and with clocks of their own, become a capture by COLMAP:
# footage.sh L4DTRAIN L4DCODEC PYTHON. Exit status 77: no COLMAP or no ffmpeg.
set -euo pipefail

train=$1 codec=$2 python=$3
for program in colmap ffmpeg; do
  command -v $program >/dev/null || { echo "SKIPPED: no $program"; exit 77; }
done
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"

"$codec" synth --scene square --seconds 5 -n 100k -o square.ply -q
"$codec" cameras square.ply --grid 4x2 --size 960x540 -o cameras.json -q
"$train" capture square.ply -o truth --cameras cameras.json --frames 120 --format mp4 -q
mkdir footage
cp truth/cam*.mp4 footage
# One begins half a second late, one was held upright, one has another codec, one drops frames.
ffmpeg -v error -y -ss 0.5 -i truth/cam03.mp4 -c:v libx264 -crf 12 footage/cam03.mp4
ffmpeg -v error -i truth/cam05.mp4 -vf transpose=1 -c:v libx264 -crf 12 turned.mp4
ffmpeg -v error -y -i turned.mp4 -metadata:s:v rotate=90 -c copy footage/cam05.mp4
ffmpeg -v error -y -i truth/cam06.mp4 -c:v libx265 -crf 12 -x265-params log-level=none footage/cam06.mp4
ffmpeg -v error -y -i truth/cam02.mp4 -vf "select='mod(n,7)'" -vsync passthrough -c:v libx264 -crf 12 footage/cam02.mp4
"$train" capture footage -o capture
"$train" inspect capture
"$python" - <<'PY'
import json, math

def load(path):
    cameras = json.load(open(path))["cameras"]
    return {c["video"].split("/")[-1]: c for c in cameras}

def center(c):
    m = c["w2c"]
    return [-sum(m[r][k] * m[r][3] for r in range(3)) for k in range(3)]

truth, found = load("truth/cameras.json"), load("capture/cameras.json")
assert sorted(truth) == sorted(found), sorted(found)
for name, camera in found.items():
    offset = camera.get("time_offset", 0)
    assert abs(offset - (0.5 if name == "cam03.mp4" else 0)) < 0.07, (name, offset)
    assert 0.93 < camera["K"][0][0] / truth[name]["K"][0][0] < 1.07, (name, camera["K"])
# Distances between cameras, up to one scale.
names = sorted(truth)
def distances(cameras):
    return [math.dist(center(cameras[a]), center(cameras[b])) for a in names for b in names if a < b]
a, b = distances(truth), distances(found)
scale = sum(x * y for x, y in zip(a, b)) / sum(y * y for y in b)
worst = max(abs(x - scale * y) for x, y in zip(a, b)) / max(a)
print("distances between cameras are off by at most %.3f of the largest" % worst)
assert worst < 0.03, worst
PY

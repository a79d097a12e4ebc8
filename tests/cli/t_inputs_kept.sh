# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# No file that a command reads is written by it, however both are named, and no file is written twice.
make_scene s.ply 500
make_cameras c.json
expect 0 encode s.ply -o s.l4d --preset lossless --order s.order
expect 0 sensitivity s.ply --cameras c.json --frames 0:60:30 -o w.ply
mkdir d
ln -s ../s.ply d/soft.ply
ln s.ply d/hard.ply
ln -s d e
ln w.ply hard-w.ply
ln -s "$PWD/c.json" soft-c
ln -s d/new.l4d dangling.l4d
cp -r --preserve=all . ../kept-"$$"
kept=$PWD/../kept-$$
trap 'rm -rf "$kept"' EXIT

# kept ARGUMENTS...: a usage error that names the conflict, and every file is what it was.
kept() {
  expect 2 "$@"
  expect_text err 'are the same file$'
  local name
  for name in s.ply s.l4d s.order w.ply c.json; do
    cmp "$name" "$kept/$name" || die "l4dcodec $*: changed $name"
  done
  expect_equal "$* $(ls d)" "$* $(ls "$kept/d")"
}

# Every verb and every option that names a file, with --force.
for output in s.ply ./s.ply d/../s.ply "$PWD/s.ply" d/soft.ply d/hard.ply e/hard.ply; do
  kept decode s.ply -f -o "$output"
  kept slice s.ply --time 1 -f -o "$output"
  kept sensitivity s.ply --cameras c.json -f -o "$output"
done
ln s.ply plain
kept encode s.ply -f -o plain
rm plain
ln s.l4d t.l4d
kept encode s.l4d -f -o t.l4d
rm t.l4d
kept encode s.ply -f -o new.l4d --order s.ply
kept encode s.ply -f -o new.l4d --order d/hard.ply
kept encode s.ply -f -o new.l4d --weights w.ply --order w.ply
kept encode s.ply -f -o new.l4d --weights w.ply --order hard-w.ply
kept encode s.ply -f -o new.l4d --cameras c.json --order soft-c
kept encode s.ply -f -o new.l4d --cameras c.json --save-weights d/hard.ply
ln w.ply weights
kept encode s.ply -f -o weights --weights w.ply
kept encode s.ply -f -o soft-c --cameras c.json
kept render s.ply -f -o soft-c --cameras c.json
kept sensitivity s.ply -f -o soft-c --cameras c.json
kept compare s.ply s.l4d --cameras c.json -f --side-by-side soft-c
kept compare s.ply s.l4d --order s.order --cameras c.json -f --side-by-side soft-c
ln s.order order
kept compare s.ply s.l4d --order s.order --cameras c.json -f --side-by-side order
ln s.l4d stream
kept compare s.ply s.l4d --cameras c.json -f --side-by-side stream
kept info s.l4d -f --plot stream
kept render s.l4d -f -o stream
rm weights order stream

# One frame of a sequence among inputs.
cp s.ply f_3.ply
expect 2 slice f_3.ply --from 0 --to 1 --fps 5 -f -o f_%d.ply
expect_text err '^l4dcodec: f_3.ply: the input and --output are the same file$'
cmp f_3.ply s.ply
expect_missing f_0.ply
ln c.json g_02
expect 2 render s.ply --cameras c.json --range 0:1 --fps 5 -f -o g_%02d
cmp c.json g_02
expect_missing g_00
rm g_02 f_3.ply

# Pictures and videos that a file of cameras names.
expect 0 render s.ply --cameras c.json --time 1 -o seen.png
cp seen.png seen.copy
cat > t.json << 'END'
{"camera_angle_x": 0.8, "w": 96, "h": 64, "frames": [{"file_path": "./seen", "transform_matrix":
 [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 8], [0, 0, 0, 1]]}]}
END
kept render s.ply --cameras t.json -f -o seen.png
cmp seen.png seen.copy
printf 'a video' > cam2.mp4
kept render s.ply --cameras c.json --camera 1 -f -o cam2.mp4
expect_equal "$(cat cam2.mp4)" 'a video'
rm cam2.mp4

# Two outputs of one name, be it there already or not.
kept encode s.ply -o new --order new
kept encode s.ply -o new --order d/../new
kept encode s.ply -o new --order ./new -f
kept encode s.ply -o dangling.l4d --order d/new.l4d -f
kept encode s.ply -o new --cameras c.json --save-weights e/../new
printf old > both
ln both both2
kept encode s.ply -o both --order both2 -f
expect_equal "$(cat both both2)" oldold
printf old > h_0.png
ln -s h_0.png h_1.png
kept render s.ply --cameras c.json --range 0:1 --fps 4 -o h_%d.png -f
expect_equal "$(cat h_0.png)" old
expect_missing new d/new.l4d h_2.png

# Standard streams that are files: nothing is read and written in earnest.
# shellcheck disable=SC2094
{
  status=0
  l4d decode - -f -o s.ply < s.ply 2> err || status=$?
  expect_equal "$status" 2
  cmp s.ply "$kept/s.ply"
  status=0
  l4d info s.ply >> s.ply 2> err || status=$?
  expect_equal "$status" 2
  cmp s.ply "$kept/s.ply"
  status=0
  l4d encode s.ply -o - --order order > order 2> err || status=$?
  expect_equal "$status" 2
}

# What a dead writer of the output would have left is no input to lose.
cp s.ply new.l4d.l4dtmp0
kept encode new.l4d.l4dtmp0 -o new.l4d
cmp new.l4d.l4dtmp0 s.ply

# Files that the input names.
expect 0 slice s.ply --time 1 -o one.glb
"$PYTHON" - <<'PY'
import json
data = open("one.glb", "rb").read()
size = int.from_bytes(data[12:16], "little")
document = json.loads(data[20:20 + size])
document["buffers"][0]["uri"] = "one.bin"
open("one.gltf", "w").write(json.dumps(document))
open("one.bin", "wb").write(data[28 + size:])
PY
cp one.bin before
kept encode one.gltf --estimate -f -o one.bin
cmp one.bin before

# The same device may be named twice.
expect 0 encode s.ply -o /dev/null --order /dev/null --preset lossless

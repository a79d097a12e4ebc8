# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# A file of cameras may come from anywhere: what it can have read is what lies beside it, and only as
# what it is.
need_ffmpeg
make_scene s.ply 800
mkdir set outside
make_cameras set/c.json
for k in 0 1 2 3; do
  l4d render s.ply --cameras set/c.json --camera "$k" -q -o "set/cam$k.mp4"
done
images() { expect "$1" compare s.ply s.ply --images --cameras "${@:2}"; }
images 0 set/c.json --ids 0 --frames 3

# cameras FROM TO FILE: another name of the videos.
cameras() { sed "s|\"video\": \"$1|\"video\": \"$2|g" set/c.json > "$3"; }
mv set/cam0.mp4 outside/
cameras cam ../outside/cam set/up.json
cameras cam "$PWD/outside/cam" set/absolute.json
cameras cam ./x/../../outside/cam set/round.json
for file in up absolute round; do
  images 2 set/$file.json --ids 0 --frames 3
  expect_text err "camera 0: .*outside/cam0.mp4 is not in the folder of the cameras; --any-path"
  images 0 set/$file.json --ids 0 --frames 3 --any-path
  # Cameras alone are read all the same.
  expect 0 compare s.ply s.ply --cameras set/$file.json --ids 0 --frames 3
done
expect 2 encode s.ply -o s.l4d --cameras set/up.json --target-psnr-loss 0.5dB --ids 0 --frames 3
expect_text err '--any-path'
expect 2 compare s.ply s.ply --orbit 2 --any-path
# A folder below, and a way that only looks like one out.
mkdir set/below
mv outside/cam0.mp4 set/below/
cameras cam below/cam set/down.json
images 0 set/down.json --ids 0 --frames 3
cameras cam below/../below/cam set/turn.json
images 0 set/turn.json --ids 0 --frames 3

# Lists of files are no videos, whatever they are called.
printf 'ffconcat version 1.0\nfile below/cam0.mp4\n' > set/cam0.mp4
images 3 set/c.json --ids 0 --frames 3
expect_text err '^l4dcodec: camera 0: set/cam0.mp4: ffmpeg failed:'
printf '#EXTM3U\n#EXT-X-TARGETDURATION:9\n#EXTINF:2,\nbelow/cam0.mp4\n#EXT-X-ENDLIST\n' > set/cam0.mp4
images 3 set/c.json --ids 0 --frames 3
expect 0 render s.ply --cameras set/c.json --time 1 -o set/below/0.png
cp set/below/0.png set/cam0.mp4
images 3 set/c.json --ids 0 --frames 3
mkfifo pipe.mp4
mv pipe.mp4 set/cam3.mp4 -f
images 3 set/c.json --ids 3 --frames 3

# Images, and their size where nothing else tells it.
transforms() {
  cat > set/t.json << END
{"camera_angle_x": 0.8, $2 "frames": [{"file_path": "$1", "transform_matrix":
 [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 8], [0, 0, 0, 1]]}]}
END
}
cp set/below/0.png outside/
transforms below/0 ''
images 0 set/t.json
for name in ../outside/0 "$PWD/outside/0.png"; do
  transforms "$name" ''
  images 2 set/t.json
  expect 2 render s.ply --cameras set/t.json -o r.png
  expect 0 render s.ply --cameras set/t.json -o r.png -f --any-path
  images 0 set/t.json --any-path
  transforms "$name" '"w": 96, "h": 64,'
  expect 0 render s.ply --cameras set/t.json -o r.png -f
  images 2 set/t.json
  images 0 set/t.json --any-path
done

# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# Times of D-NeRF cameras are multiplied by --seconds, whatever the sequence lasts: as l4dtrain does.
make_scene s.ply 800 # of 2 s, 60 frames
# A camera at T seconds of a scene whose 1 is 4 s.
cat > transforms_test.json << END
{"w": 96, "h": 64, "camera_angle_x": 0.8, "frames": [{"time": 0.25, "transform_matrix":
 [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 8], [0, 0, 0, 1]]}]}
END
expect 0 encode s.ply -o s.l4d
time_of() { json out 'd["per_view"][0]["time"]'; }
for b in s.ply s.l4d; do
  expect_document 0 compare s.ply $b --cameras transforms_test.json --per-view
  expect_equal "$(time_of)" 0.25
  expect_json out 'any("--seconds (1): the last view is at 0.25 s, and the sequence lasts 2 s." in n for n in d["notes"])'
  expect_document 0 compare s.ply $b --cameras transforms_test.json --per-view --seconds 4
  expect_equal "$(time_of)" 1.0
  expect_json out 'd["per_view"][0]["frame"] == 30'
  expect_document 0 compare s.ply $b --cameras transforms_test.json --per-view --seconds 0:40
  expect_equal "$(time_of)" 2.0
  expect_json out 'any("views after its end show its end" in n for n in d["notes"])'
done
expect 2 compare s.ply s.l4d --cameras transforms_test.json --seconds 0
# The image is that of the instant.
expect 0 render s.l4d --cameras transforms_test.json --time 1 -o at_one.png
sed 's|"time"|"file_path": "at_one", "time"|' transforms_test.json > seen.json
expect_document 0 compare s.l4d s.l4d --cameras seen.json --images --seconds 4
expect_json out 'd["psnr_a_db"] > 50'
expect_document 0 compare s.l4d s.l4d --cameras seen.json --images
expect_json out 'd["psnr_a_db"] < 50'

# Importance and targets look at the same instants.
expect_document 0 sensitivity s.ply --cameras transforms_test.json -o w.ply --seconds 4
expect_json out 'any("--seconds (4): the last view is at 1 s" in n for n in d["notes"])'
expect_document 0 encode s.ply -o w.l4d --cameras transforms_test.json --seconds 4
expect_json out 'any("--seconds (4): the last view is at 1 s" in n for n in d["notes"])'
expect_document 0 encode s.ply -o t.l4d --cameras transforms_test.json --seconds 4 --target-fidelity 30dB
expect_json out 'any("--seconds (4): the last view is at 1 s" in n for n in d["notes"])'

# Cameras that look away tell nothing, and the encode says so, refitted or not.
sed 's/\[0, 0, 1, 8\]/[0, 0, 1, -500]/' transforms_test.json > away.json
for refit in 0 2; do
  expect 4 encode s.ply -o none.l4d --cameras away.json --refit $refit
  expect_text err 'the cameras show nothing of s.ply'
  expect_missing none.l4d
done

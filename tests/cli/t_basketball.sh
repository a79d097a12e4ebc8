# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# A real dynamic scene, trained from video.
need_data basketball/basketball.ply
scene=$DATA/basketball/basketball.ply

expect 0 encode "$scene" -o lossless.l4d --preset lossless
expect_document 0 compare "$scene" lossless.l4d --exact
expect_json out 'd["matched"] == 213874'
expect 0 decode lossless.l4d -o back.ply
expect 0 compare "$scene" back.ply --exact
expect 0 validate lossless.l4d

expect_document 0 encode "$scene" -o b.l4d --order b.order \
  --weights "$DATA/basketball/basketball-weights.ply" --verify
expect_json out 'd["input_gaussians"] == 213874 and d["raw_bytes"] == 55607240'
expect_json out 'd["ratio"] > 10 and d["verify"]["matched"] == d["coded_gaussians"]'
cp out encode.json
expect 0 validate b.l4d
# What compare finds by itself is what encode states and measures.
expect_document 0 compare "$scene" b.l4d
expect_json out 'd["match"] == "stated" and d["matched"] == d["num_gaussians_b"]'
"$PYTHON" -c 'import json
encoded, seen = json.load(open("encode.json")), json.load(open("out"))
for name, error in seen["seen"].items():
    if name != "min_size":
        assert error["max"] <= encoded["max_errors"][name] * 1.0001, (name, error)
exact, found = (d["visible_position"]["rmse"] for d in (encoded["verify"], seen))
assert abs(found - exact) < 0.02 * exact, (found, exact)'
expect_document 0 info b.l4d --time 2.5
expect_json out 'd["seek"]["visible"] > 100000 and d["duration_s"] == 5'
expect_document 0 slice b.l4d --from 2 --to 2.5 --fps 30 -o f_%02d.ply
expect_json out 'd["num_frames"] == 15'

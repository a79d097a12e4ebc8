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
exact=$(json out 'd["verify"]["visible_position"]["rmse"]')
expect 0 validate b.l4d
# Guessing the pairs does not make the scene look much worse than it is.
expect_document 0 compare "$scene" b.l4d
nearest=$(json out 'd["visible_position"]["rmse"]')
"$PYTHON" -c "assert $nearest < 2 * $exact, ($nearest, $exact)"
expect_document 0 info b.l4d --time 2.5
expect_json out 'd["seek"]["visible"] > 100000 and d["duration_s"] == 5'
expect_document 0 slice b.l4d --from 2 --to 2.5 --fps 30 -o f_%02d.ply
expect_json out 'd["num_frames"] == 15'

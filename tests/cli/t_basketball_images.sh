# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# Images of a real scene against the videos it was trained from.
need_data basketball/basketball.ply
need_ffmpeg
scene=$DATA/basketball/basketball.ply
cameras=$DATA/basketball/cameras.json

expect 0 encode "$scene" -o b.l4d \
  --weights "$DATA/basketball/basketball-weights.ply"
expect_document 0 compare "$scene" b.l4d --cameras "$cameras" --frames 0:150:10 --images
expect_json out 'd["views"] == 60 and d["worst_view"]["camera"] in (0, 10, 15, 30)'
# What another renderer measured of this scene in these views: 26.28 dB and 0.898.
expect_json out 'abs(d["psnr_a_db"] - 26.28) < 0.03 and abs(d["ssim_a"] - 0.898) < 0.002'
expect_json out 'd["fidelity_db"] > 30 and d["psnr_b_db"] > d["psnr_a_db"] - 1'

# Halves of the views agree before all of them were measured.
expect_document 0 sensitivity "$scene" --cameras "$cameras" --frames 0:150:30 --agreement 0.85 -o w.ply
expect_json out 'd["views"] == 135 and d["agreed"] and d["views_measured"] < 135'

# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# Real static captures in 3DGS PLY: no tool of time is used.
need_data statues/angel.ply
expect_document 0 encode "$DATA/statues/angel.ply" -o angel.l4d --seconds 4 --fps 25 \
  --drop-invalid --verify
expect_json out 'd["source"] == "3dgs_ply" and d["input_gaussians"] == 71359'
expect_json out 'd["verify"]["matched"] == d["coded_gaussians"] > 71000'
coded=$(json out 'd["coded_gaussians"]')
expect_document 0 info angel.l4d --time 2
expect_json out 'not {"motion", "temporal-opacity", "view-dependence"} & set(d["tools"])'
expect_json out "d['num_frames'] == 100 and d['seek']['visible'] == $coded"
expect 0 validate angel.l4d
expect_document 0 slice angel.l4d --time 1 -o a.ply
expect_document 0 slice angel.l4d --time 3 -o b.ply
cmp a.ply b.ply
expect 0 encode a.ply -o again.l4d

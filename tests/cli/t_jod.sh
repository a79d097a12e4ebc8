# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# What people see of a coded scene as video.
make_scene s.ply 800
make_cameras c.json
expect 0 encode s.ply -o fine.l4d --quality 40
expect 0 encode s.ply -o coarse.l4d --quality 25
jod=(--cameras c.json --ids 0 --frames 0:4 --jod)
expect_document 0 compare s.ply s.ply "${jod[@]}"
expect_json out 'd["jod"] == 10 and d["jod_display"] == "standard_4k" and len(d["jod_cameras"]) == 1'
expect_document 0 compare s.ply fine.l4d "${jod[@]}"
cp out fine.json
expect_document 0 compare s.ply coarse.l4d "${jod[@]}" --display standard_fhd
expect_json out "d['jod'] < json.load(open('fine.json'))['jod'] < 10 and d['jod_cameras'][0]['frames'] == 4"
expect 0 compare s.ply coarse.l4d "${jod[@]}"
expect_text out 'mean JOD, B against A .*standard_4k, 75.40 pixels a degree'
expect 1 compare s.ply coarse.l4d --cameras c.json --ids 0 --frames 0:4 --min-jod 9.999
expect_text out 'not met: JOD of every camera >= 9.999'
# An image has no motion.
expect_document 0 compare s.ply coarse.l4d --cameras c.json --ids 0 --frames 2 --jod
expect_json out 'd["jod_cameras"][0]["frames"] == 1 and d["jod_cameras"][0]["fps"] == 0'
expect 2 compare s.ply s.ply --jod
expect_text err 'need --cameras'
expect 2 compare s.ply s.ply --cameras c.json --display standard_fhd
expect_text err '--display needs --jod'
expect 2 compare s.ply s.ply "${jod[@]}" --display cinema
expect_text err '--display is cinema; it must be standard_4k or standard_fhd'

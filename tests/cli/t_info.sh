# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# info: what a scene holds, what a seek costs, and that tools that are off are really off.
make_scene s.ply 10k
expect 0 encode s.ply -o s.l4d --codebook all=128
expect_document 0 info s.l4d --time 1
bytes=$(wc -c < s.l4d)
expect_json out "d['file_bytes'] == d['stream_bytes'] == $bytes == sum(d['sections'].values())"
expect_json out 'd["num_gaussians"] == 10000 == sum(l["num_gaussians"] for l in d["layers"])'
expect_json out 'd["num_layers"] == len(d["layers"]) and d["source"] == "l4d"'
expect_json out '[l["index"] for l in d["layers"]] == list(range(d["num_layers"]))'
expect_json out 'd["num_frames"] == 60 and d["fps"] == 30 and d["duration_s"] == 2'
expect_json out 'd["sh_degree"] == 3 and set(d["tools"]) == set(d["tool_reasons"])'
expect_json out '"motion" in d["tools"] and "lossless" not in d["tools"]'
expect_json out '0 < d["seek"]["visible"] <= d["seek"]["gaussians"] <= 10000'
expect_json out '0 < d["seek"]["bytes"] < d["file_bytes"] and d["seek"]["chunks"] > 0'
expect_json out '0 < d["seek"]["buckets"] <= 3 * d["num_layers"]'
expect 0 info s.l4d --time 1
expect_text out 'motion +[0-9]+ of [0-9]+ layers have temporal rotors'
expect_text out '^seek to 1 s: '

# A time outside is limited to the sequence, aloud.
expect 0 info s.l4d --time 99
expect_text err '^note: --time 99 lies outside'
expect_document 0 info s.l4d --time 99
expect_json out 'd["seek"]["time"] == 2 and len(d["notes"]) == 1'
expect_document 0 info s.l4d --time 0:01.5
expect_json out 'd["seek"]["time"] == 1.5'

# A PLY is looked at as a lossless stream.
expect_document 0 info s.ply --time 1
expect_json out 'd["source"] == "l4d_ply" and "lossless" in d["tools"] and len(d["notes"]) == 1'
expect_json out "d['file_bytes'] == $(wc -c < s.ply) != d['stream_bytes']"

# A scene pays for what it uses.
expect 0 synth -n 5000 --effects static -o static.ply
expect 0 encode static.ply -o static.l4d --codebook all=128
expect_document 0 info static.l4d
expect_json out 'not {"motion", "temporal-opacity", "view-dependence"} & set(d["tools"])'
expect_json out 'd["sections"]["rotor_temporal"] == d["sections"]["mean_t"] == 0'
expect_json out 'd["sh_degree"] == 0 and d["num_layers"] == 1 and d["layers"][0]["permanent"]'
expect 0 synth -n 5000 --effects static,view -o view.ply
expect 0 encode view.ply -o view.l4d --codebook all=128
expect_document 0 info view.l4d
expect_json out '"view-dependence" in d["tools"] and "motion" not in d["tools"]'

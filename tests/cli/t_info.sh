# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# info: what a scene holds, what a seek costs, and that tools that are off are really off.
make_scene s.ply 10k
expect 0 encode s.ply -o s.l4d --preset indexed --codebook all=128
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
# Bits of each section, which add up to those of the file.
expect_json out 'abs(sum(d["section_bits_per_gaussian"].values()) - d["bits_per_gaussian"]) < 1e-6'
expect_json out 'all(abs(d["section_bits_per_gaussian"][k] - 8e-4 * v) < 1e-9 for k, v in d["sections"].items())'
expect 0 info s.l4d --time 1
expect_text out '^sh +[0-9,]+ +[0-9.]+ % +[0-9]+\.[0-9]{2}$'
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
expect 0 synth --scene cloud -n 5000 --effects static -o static.ply
expect 0 encode static.ply -o static.l4d
expect_document 0 info static.l4d
expect_json out 'not {"motion", "temporal-opacity", "view-dependence"} & set(d["tools"])'
expect_json out 'd["sections"]["rotor_temporal"] == d["sections"]["mean_t"] == 0'
expect_json out 'd["sh_degree"] == 0 and d["num_layers"] == 1 and d["layers"][0]["permanent"]'
expect 0 synth --scene cloud -n 5000 --effects static,view -o view.ply
expect 0 encode view.ply -o view.l4d
expect_document 0 info view.l4d
expect_json out '"view-dependence" in d["tools"] and "motion" not in d["tools"]'

# Every tool in use is named.
expect 0 encode s.ply -o default.l4d
expect_document 0 info default.l4d
expect_json out '{"transform", "rans"} <= set(d["tools"]) and "residual-stages" not in d["tools"]'
# What the header declares is what the stream keeps to, and components say how they are coded.
expect_json out 'd["declared_profile"] == "main" and d["declared_level"] >= 1'
expect_json out 'all(c["coding"] == "transform" and c["coefficients"] > 0 == c["stages"] for l in d["layers"] for c in l["components"].values())'
expect 0 encode s.ply -o codebooks.l4d --preset indexed --codebook all=128
expect_document 0 info codebooks.l4d
expect_json out 'all(l["components"]["sh"]["coding"] == "codebooks" and l["components"]["sh"]["coefficients"] == 0 for l in d["layers"])'
expect 0 info default.l4d
grep -q "declared profile main, level" out || die "no profile in the text"
grep -q "sh transform" out || die "no codings in the text"

# What leaving out fine levels, or SH detail, saves. Small pages have no detail apart.
make_scene large.ply 60k
expect 0 encode large.ply -o large.l4d --set coding.sh=1
expect_document 0 info large.l4d --time 1
expect_json out '"sh-base" in d["tools"] and len(d["scalable"]) == len({l["level"] for l in d["layers"]})'
expect_json out 'd["scalable"][-1]["bytes"] == d["file_bytes"] and d["scalable"][-1]["num_gaussians"] == d["num_gaussians"]'
expect_json out 'all(r["base_bytes"] < r["bytes"] for r in d["scalable"])'
expect_json out 'all(a["bytes"] < b["bytes"] and a["base_bytes"] <= b["base_bytes"] for a, b in zip(d["scalable"], d["scalable"][1:]))'
expect_json out 'd["seek"]["detail"] == "full" and 0 < d["seek"]["sh_detail_bytes"] < d["seek"]["bytes"]'
full=$(json out 'd["seek"]["bytes"] - d["seek"]["sh_detail_bytes"]')
expect_document 0 info large.l4d --time 1 --detail base
expect_json out "d['seek']['detail'] == 'base' and d['seek']['bytes'] == $full"
expect 0 info large.l4d --time 1
expect_text out '^scalable up to +base colour'
expect_text out '^level 0 +[0-9,]+ +[0-9.]+ % +[0-9,]+ +[0-9.]+ % +[0-9,]+$'
expect 2 info large.l4d --detail best

# What a player fetches over time: all of the file, once, and no more at a time than a seek takes.
expect 0 synth --scene cloud -q -n 10000 --seconds 20 --fps 30 --seed 7 -o long.ply
expect 0 encode long.ply -o long.l4d --set merge-count=0 --set merge-fraction=0 --set page-size=256
expect_document 0 info long.l4d --plot long.svg --time 0
"$PYTHON" -c 'import json, xml.etree.ElementTree as tree
d = json.load(open("out"))
o = d["over_time"]
steps = len(o["times"])
assert steps == 600 and o["frames_per_step"] == 1
assert abs(o["times"][-1] - 599 / 30) < 1e-9
rows = [level["bytes"] for level in o["levels"]] + [o["directory_bytes"]]
assert all(len(row) == steps for row in rows + [o["gaussians"], o["visible"]])
assert len({l["level"] for l in d["layers"]}) == len(o["levels"]) > 2
step_bytes = [sum(column) for column in zip(*rows)]
total = o["setup_bytes"] + sum(step_bytes)
assert 0.97 * d["file_bytes"] < total <= d["file_bytes"], (total, d["file_bytes"])
assert o["opening_bytes"] == o["setup_bytes"] + step_bytes[0]
assert sum(row[0] for row in rows[:-1]) == d["seek"]["bytes"]
assert o["gaussians"][0] == d["seek"]["gaussians"] and o["visible"][0] == d["seek"]["visible"]
assert all(0 < v <= g for v, g in zip(o["visible"], o["gaussians"]))
assert abs(o["mean_bytes_per_s"] - sum(step_bytes[1:]) / (599 / 30)) < 1e-3
windows = [sum(step_bytes[k:k + 30]) for k in range(1, steps - 29)]
assert abs(o["peak_bytes_per_s"] - max(windows)) < 1e-3
root = tree.parse("long.svg").getroot()
assert root.tag == "{http://www.w3.org/2000/svg}svg"
texts = [e.text for e in root.iter("{http://www.w3.org/2000/svg}text")]
assert "long.l4d" in texts and "visible" in texts and "directory" in texts
width, height = float(root.get("width")), float(root.get("height"))
for tag, count in (("polygon", len(rows)), ("polyline", 2)):
    shapes = [e.get("points") for e in root.iter("{http://www.w3.org/2000/svg}" + tag)]
    assert len(shapes) == count, (tag, len(shapes))
    points = [tuple(map(float, p.split(","))) for s in shapes for p in s.split()]
    assert all(0 <= x <= width and 0 <= y <= height for x, y in points)'
expect 3 info long.l4d --plot long.svg
expect 0 info long.l4d --plot - --quiet
cmp out long.svg
# A scene that never changes, and one with a name that XML must not take as it is.
cp static.l4d 'a<b>&c.l4d'
expect_document 0 info 'a<b>&c.l4d' --plot static.svg
expect_json out 'sum(sum(l["bytes"][1:]) for l in d["over_time"]["levels"]) == 0'
"$PYTHON" -c 'import xml.etree.ElementTree as tree; assert tree.parse("static.svg").getroot()[1].text == "a<b>&c.l4d"'

# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# Quantised streams: parameters act, errors are measured, results are reproducible.
make_scene s.ply 20k
expect_document 0 encode s.ply -o s.l4d --preset indexed --codebook all=256 --order s.order --verify
expect_json out 'd["ratio"] > 4 and d["preset"] == "indexed"'
cp out encode.json
expect_document 0 compare s.ply s.l4d --order s.order
expect_json out 'd["match"] == "order" and d["matched"] == 20000 and not d["identical"]'
cp out compare.json
# --verify and compare --order are one measurement.
"$PYTHON" -c 'import json
a = json.load(open("encode.json"))["verify"]
b = json.load(open("compare.json"))
for key in ("attributes", "visible_position", "match", "matched"):
    assert a[key] == b[key], key
v = b["visible_position"]
assert 0 < v["rmse"] <= v["p999"] <= v["max"]
assert sum(l["gaussians"] for l in v["layers"]) == v["gaussians"] <= 20000
assert max(l["max"] for l in v["layers"]) == v["max"]'

# Without the order pairs are found that keep what the stream states.
expect_document 0 compare s.ply s.l4d
expect_json out 'd["match"] == "stated" and d["matched"] == 20000 and d["unmatched"] == 0'
"$PYTHON" -c 'import json
encoded, ordered, found = (json.load(open(f)) for f in ("encode.json", "compare.json", "out"))
for name, error in found["seen"].items():
    if name != "min_size":
        assert error["max"] <= encoded["max_errors"][name] * 1.0001, (name, error)
a, b = (d["visible_position"]["rmse"] for d in (ordered, found))
assert abs(a - b) < 0.02 * a, (a, b)'
expect 0 compare s.ply s.l4d --max-error opacity=1 --max-error visible_position=1e6
# If no pairs do, or nothing is stated, nothing is said of single Gaussians.
expect 0 decode s.l4d -o back.ply
expect 0 synth --seconds 5 --gaussians 20k --seed 9 -o other.ply
for pair in 's.ply back.ply' 'other.ply s.l4d'; do
  # shellcheck disable=SC2086
  expect_document 0 compare $pair
  expect_json out 'd["match"] == "unknown" and d["equal_rows"] == d["matched"] == 0'
  expect_json out 'not {"attributes", "seen", "visible_position"} & set(d)'
  # shellcheck disable=SC2086
  expect 2 compare $pair --max-error opacity=1
  expect_text err 'which Gaussian of .* is not known. .encode --order FILE. writes it'
done
expect 0 compare s.ply back.ply
expect_text out '^single Gaussians are not compared: .*.encode --verify. measures at once$'

# Bounds decide the exit status.
expect 0 compare s.ply s.l4d --order s.order --max-error opacity=1 --max-error visible_position=1e6
expect_document 1 compare s.ply s.l4d --order s.order --max-error opacity=1 --max-error sh=1e-9
expect_json out 'd["not_met"] == ["max error of sh <= 1e-09"]'
expect 1 compare s.ply s.l4d --exact
# An order of another scene is refused.
head -c 400 s.order > short.order
expect 2 compare s.ply s.l4d --order short.order
printf 'abc' > odd.order
expect 4 compare s.ply s.l4d --order odd.order

# Reproducible: seed and threads.
expect 0 encode s.ply -o t1.l4d --preset indexed --codebook all=256 --threads 1
expect 0 encode s.ply -o t3.l4d --preset indexed --codebook all=256 --threads 3
cmp s.l4d t1.l4d
cmp s.l4d t3.l4d

# Ways to say the same.
expect 0 encode s.ply -o set.l4d --preset indexed --set codebook-size=256
cmp s.l4d set.l4d
expect 0 encode s.ply -o each.l4d --preset indexed --codebook sh=256 --codebook scale=256 \
  --set codebook-size.rotor-spatial=256 --set codebook-size.rotor-temporal=0.25Ki
cmp s.l4d each.l4d

# Parameters do what they say.
# Without bounds on colours, which mend what few stages miss.
unbounded=(--set max-base-color-error=0 --set max-directional-color-error=0)
expect 0 encode s.ply -o one.l4d --preset indexed --codebook all=256 --stages all=1 --order one.order "${unbounded[@]}"
expect_document 0 compare s.ply one.l4d --order one.order
cp out few.json
expect 0 encode s.ply -o stages.l4d --preset indexed --codebook all=256 --stages all=1,1,0.5 --order stages.order "${unbounded[@]}"
expect_document 0 info stages.l4d
expect_json out '"residual-stages" in d["tools"]'
expect_json out 'all(l["components"]["sh"]["stages"] == 3 for l in d["layers"])'
expect_document 0 compare s.ply stages.l4d --order stages.order
"$PYTHON" -c 'import json
few = json.load(open("few.json"))["attributes"]
more = json.load(open("out"))["attributes"]
assert more["sh"]["rmse"] < few["sh"]["rmse"]
assert more["log_scale"]["rmse"] < few["log_scale"]["rmse"]'
expect 0 encode s.ply -o never.l4d --preset indexed --codebook all=256 --rcq never
expect_document 0 info never.l4d
expect_json out '"rcq" not in d["tools"]'
expect 0 encode s.ply -o escape.l4d --preset indexed --codebook all=256 --escape-threshold sh=1e-30
expect_document 0 info escape.l4d
expect_json out '"escapes" in d["tools"]'

# Block codebooks where they were asked for, or a word that there are none.
expect 0 encode s.ply -o always.l4d --preset indexed --codebook all=64 --rcq always --set merge-count=100
expect_empty err
expect_document 0 info always.l4d
expect_json out '"rcq" in d["tools"]'
expect 0 synth --scene cloud --seconds 2 --gaussians 2000 --effects static -o static.ply
expect 0 encode static.ply -o static.l4d --preset indexed --rcq always
expect_text err 'no block codebooks were written'

# Transcoding a stream, and a stream as A of a comparison.
expect 0 encode stages.l4d -o transcoded.l4d --preset indexed --codebook all=64
expect_document 0 compare stages.l4d transcoded.l4d
expect_json out 'd["matched"] == 20000'

# FreeTimeGS has normalised time, so its export is an approximation, and a good one.
expect_document 0 decode s.l4d -o s.ftgs.ply --format ftgs
"$PYTHON" -c 'import array, sys
sys.stdout.buffer.write(array.array("I", range(20000)).tobytes())' > as-is.order
expect_document 0 compare s.l4d s.ftgs.ply --order as-is.order
expect_json out 'd["matched"] == 20000 and d["attributes"]["opacity"]["max"] < 1e-3'

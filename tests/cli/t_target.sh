# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# encode --quality, and targets that a quality is searched for.
make_scene s.ply 4000
make_cameras c.json

# --quality is the parameter, and finer is larger.
expect_document 0 encode s.ply -o q40.l4d --quality 40
expect_json out 'd["quality"] == 40 and "target" not in d'
expect 0 encode s.ply -o set.l4d --set quality=40
cmp q40.l4d set.l4d
expect_document 0 encode s.ply -o q60.l4d --quality 60
[ "$(wc -c < q60.l4d)" -gt "$(wc -c < q40.l4d)" ] || die "more quality does not take more bytes"
expect_document 0 encode s.ply -o indexed.l4d --preset indexed --stages all=1
expect_json out '"quality" not in d'

# Codebooks follow a quality, unless their stages are given.
expect_document 0 encode s.ply -o indexed40.l4d --preset indexed --quality 40
expect_json out 'd["quality"] == 40'
expect 0 encode s.ply -o indexed60.l4d --preset indexed --quality 60
[ "$(wc -c < indexed60.l4d)" -gt "$(wc -c < indexed40.l4d)" ] || die "quality changes no codebook"

# What a target comes to is in the document: figure of the file, its quality, all trials.
# What is not near enough is explained, since figures may jump from one quality to the next.
# target KIND ASKED ARGUMENTS...
target() {
  local kind=$1 requested=$2
  shift 2
  expect_document 0 encode s.ply -o t.l4d --force "$@"
  expect_json out "d['target']['kind'] == '$kind' and d['target']['requested'] == $requested"
  expect_json out 'd["target"]["met"]'
  expect_json out 'd["quality"] == d["target"]["quality"]'
  expect_json out '{"quality": d["quality"], "reached": d["target"]["reached"]} in d["target"]["trials"]'
  expect_json out "d['file_bytes'] == $(wc -c < t.l4d) and len(d['target']['trials']) <= 16"
  reached=$(json out 'd["target"]["reached"]')
}

# Halfway between two sizes that there are.
requested=$(($(wc -c < q40.l4d) / 2 + $(wc -c < q60.l4d) / 2))
target size "$requested" --target-size "$requested"
expect_equal "$reached" "$(wc -c < t.l4d).0"
expect_json out "0.98 * $requested <= d['file_bytes'] <= $requested and 'obstacle' not in d['target']"
# The file is what its quality gives.
expect 0 encode s.ply -o same.l4d --quality "$(json out 'd["quality"]')"
cmp t.l4d same.l4d
expect 0 validate t.l4d
# The sequence has 2 s.
target bitrate "$requested / 2" --target-bitrate "$((requested * 4))bit/s"
expect_json out "0.98 * $requested <= d['file_bytes'] <= $requested"
expect 0 encode s.ply -o - --target-size "$requested" --progress plain > /dev/null
expect_text err '^encode: trial 1, [0-9.]+ dB: '
expect_text err '^trial 1, [0-9.]+ dB: .*requested$'
expect_text err ' dB, .* requested, in [0-9]+ trials$'
cmp t.l4d out

# Fidelity is what compare measures in the same views.
target fidelity 40 --orbit 4 --size 96x64 --frames 0:60:30 --target-fidelity 40dB
expect_json out '40 <= d["target"]["reached"] and d["target"]["views"] == 8'
expect_json out '(d["target"]["reached"] <= 40.1) == ("obstacle" not in d["target"])'
expect_document 0 compare s.ply t.l4d --orbit 4 --size 96x64 --frames 0:60:30 --min-fidelity 40
expect_json out "abs(d['fidelity_db'] - $reached) < 1e-6"
# Views of their own accord: no more than 60, of the cameras for testing. With weights, cameras
# are for the target alone.
expect 0 sensitivity s.ply --cameras c.json --split all --frames 0:60:10 -o w.ply
target fidelity 38 --weights w.ply --cameras c.json --target-fidelity 38
expect_json out 'd["target"]["views"] == 60 and "sensitivity" not in d and "60 of 120" in d["notes"][0]'

# JOD is what compare measures in the same videos: that of the worst camera.
target jod 9.7 --orbit 2 --size 96x64 --frames 20:30 --target-jod 9.7
expect_json out '9.7 <= d["target"]["reached"] and d["target"]["views"] == 20'
expect_json out '(d["target"]["reached"] <= 9.73) == ("obstacle" not in d["target"])'
expect_document 0 compare s.ply t.l4d --orbit 2 --size 96x64 --frames 20:30 --jod --min-jod 9.7
expect_json out "abs(d['min_jod'] - $reached) < 1e-6"
expect_json out 'd["min_jod"] == min(c["jod"] for c in d["jod_cameras"]) < d["jod"]'
# The mean over cameras, which is above the worst, is not what is demanded.
expect 1 compare s.ply t.l4d --orbit 2 --size 96x64 --frames 20:30 --min-jod "$(json out 'd["jod"]')"

# The largest error is that of compare.
target max-error 0.2 --max-error log_scale=0.2 --order t.order
expect_json out 'd["target"]["attribute"] == "log_scale" and d["target"]["reached"] <= 0.2'
expect_json out '(d["target"]["reached"] >= 0.19) == ("obstacle" not in d["target"])'
expect_document 0 compare s.ply t.l4d --order t.order --max-error log_scale=0.2
expect_json out "abs(d['attributes']['log_scale']['max'] - $reached) < 1e-9"

# Errors that the encoder bounds Gaussian by Gaussian cost what the few need, not a quality for all.
bounded() {
  target max-error "$2" --max-error "$1=$2" --order t.order
  expect_json out 'd["quality"] == 44 and len(d["target"]["trials"]) == 1'
  expect_document 0 compare s.ply t.l4d --order t.order --max-error "$1=$2"
}
expect 0 encode s.ply -o plain.l4d
bounded visible_position 0.02
bounded position_sizes 0.3
bounded covariance_factor 1.3
[ "$(wc -c < t.l4d)" -lt $(($(wc -c < plain.l4d) * 12 / 10)) ] || die "the few cost too much"

# Out of reach: the nearest there is, why, and an exit status that says no.
expect_document 1 encode s.ply -o small.l4d --target-size 1kB
expect_json out 'not d["target"]["met"] and d["quality"] == 20 and "end of 20 dB" in d["target"]["obstacle"]'
expect_json out 'any(n.startswith("not met: 1.00 kB requested, ") for n in d["notes"])'
expect 0 validate small.l4d
# A target that the best quality does not fill is met.
expect_document 0 encode s.ply -o large.l4d --target-size 1GB
expect_json out 'd["target"]["met"] and d["quality"] == 90 and "end of 90 dB" in d["target"]["obstacle"]'
reached='[0-9.]+ kB is the nearest that was reached: the quality is at its end of 20 dB$'
expect 1 encode s.ply -o small.l4d --target-size 1kB --force
expect_text err "^note: not met: 1.00 kB requested, $reached"
expect 1 encode s.ply -o small.l4d --target-bitrate 1kB/s --force
expect_text err '^note: not met: 1.00 kB/s requested, [0-9.]+ kB/s is the nearest '
expect 1 encode s.ply -o small.l4d --orbit 2 --size 32x32 --frames 0:60:30 --target-fidelity 99 --force
expect_text err '^note: not met: 99.00 dB of fidelity requested, [0-9.]+ dB of fidelity is the nearest .*: the quality is at its end of 90 dB$'

need_ffmpeg
for k in 0 2; do
  expect 0 render s.ply --cameras c.json --camera $k -o cam$k.mp4 --crf 4
done
target psnr-loss 2 --weights w.ply --cameras c.json --frames 0:60:20 --target-psnr-loss 2dB
expect_json out 'd["target"]["reached"] <= 2 and d["target"]["views"] == 6'
expect_json out '(d["target"]["reached"] >= 1.8) == ("obstacle" not in d["target"])'
expect_document 0 compare s.ply t.l4d --cameras c.json --frames 0:60:20 --images
expect_json out "abs(d['psnr_a_db'] - d['psnr_b_db'] - $reached) < 1e-6"

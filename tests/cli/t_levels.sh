# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# Profiles and levels: declared by encode, proved or refuted by validate.
make_scene s.ply 4000
for preset in default indexed lossless; do
  profile=-1
  [ "$preset" != indexed ] || profile=1
  expect 0 encode s.ply -o $preset.l4d --preset $preset --set profile=$profile
  expect_document 0 validate $preset.l4d
  expect_json out 'd["conformance"]["declared_profile"] == d["conformance"]["profile"]'
  expect_json out 'd["conformance"]["declared_level"] == d["conformance"]["level"] == 1'
done
expect_json out 'd["conformance"]["profile"] == "lossless"'

# What is so is proved: by number, by name, and by profiles that contain others.
expect 0 validate default.l4d --level 1 --profile main
expect_text out '^claimed: profile main level 1 \(phone\): holds$'
expect 0 validate indexed.l4d --level phone --profile main
expect 0 validate indexed.l4d --level studio --profile indexed
expect 0 validate - --level 1 < lossless.l4d

# What is not so is refuted, with what breaks it.
expect_document 1 validate default.l4d --profile indexed
expect_json out 'd["valid"] and not d["conformance"]["holds"]'
expect_json out '[v["clause"] for v in d["conformance"]["violations"]] == ["LEVL-2"]'
expect 1 validate indexed.l4d --profile lossless
expect_text out 'LEVL-2 .* position is not raw32'

# Beyond a level: time, what, value and limit.
l4d synth --scene cloud -q -n 101000 --seconds 1 --fps 1 --seed 3 -o large.ply
expect 0 encode large.ply -o large.l4d --preset lossless --set level=0
expect_document 1 validate large.l4d --level phone
expect_json out 'd["valid"] and d["conformance"]["declared_level"] == 0'
expect_json out 'd["conformance"]["level"] == 2 and d["conformance"]["limits_of_level"] == 1'
expect_json out '[(q["value"], q["limit"], q["holds"]) for q in d["conformance"]["quantities"]
  if q["name"] == "instant_gaussians"] == [(101000, 100000, False)]'
expect_json out 'len(d["conformance"]["quantities"]) == 8'
expect 1 validate large.l4d --level 1
expect_text out 'LEVL-3 .*Gaussians needed at 0 s: 101000, which is 1000 more than the limit of 100000'
expect 0 validate large.l4d --level 2

# The encoder refuses what it cannot keep, and leaves nothing behind.
expect 6 encode large.ply -o x.l4d --preset lossless --set level=1
expect_text err '1000 more than the limit of 100000'
expect_missing x.l4d
expect 2 encode s.ply -o x.l4d --set profile=1
expect_text err 'profile indexed does not allow coding = 1'
expect_missing x.l4d

expect 6 encode large.ply -o x.l4d --preset lossless --level phone
expect 0 encode large.ply -o x.l4d --preset lossless --level headset
expect 0 validate x.l4d --level 2
rm x.l4d
expect 2 encode s.ply -o x.l4d --profile indexed
expect 0 encode s.ply -o x.l4d --profile indexed --preset indexed
expect 0 validate x.l4d --profile indexed
expect_document 0 info x.l4d
expect_json out 'd["stated_errors"]["bounds"]["position_sizes"] == 0 < d["stated_errors"]["position_sizes"]'
expect 0 encode s.ply -o x.l4d -f --profile main --preset indexed
expect_document 0 validate x.l4d
expect_json out 'd["conformance"]["declared_profile"] == "main"'
# Unless asked for what players of indices take, positions keep their bound.
expect 0 encode s.ply -o x.l4d -f --preset indexed
expect_document 0 info x.l4d
expect_json out 'd["stated_errors"]["position_sizes"] <= d["stated_errors"]["bounds"]["position_sizes"] == 0.5'
expect 2 encode s.ply -o y.l4d --profile best
expect_text err 'indexed, main, lossless'
expect_missing y.l4d

# Usage.
expect 2 validate s.l4d --level 9
expect_text err '1 phone, 2 headset'
expect 2 validate s.l4d --profile best
expect_text err 'indexed, main, lossless'

# A directory that cannot be read leaves nothing to measure.
"$PYTHON" -c 'import sys
data = bytearray(open("indexed.l4d", "rb").read())
at = data.index(b"L4DD") if b"L4DD" in data else len(data) // 2
data[at] ^= 0x40
open("bad.l4d", "wb").write(data)'
expect_document 1 validate bad.l4d --level 1
expect_json out 'not d["valid"]'

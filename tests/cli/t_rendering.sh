# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# How a scene asks to be drawn and shown goes from an option or a PLY into the stream, from there to
# `render`, and back into a PLY.
make_scene s.ply 3k
make_cameras c.json
expect 0 encode s.ply -o plain.l4d --estimate
expect 0 encode s.ply -o stated.l4d --estimate --rendering dilation=2,compensation=1 \
  --presentation playback=loop,camera=0:1:5:0:0:0:0:1:0:50
expect_document 0 info plain.l4d
expect_json out 'not d["rendering"]["stated"] and d["rendering"]["dilation"] - 0.3 < 1e-6'
expect_json out 'd["presentation"]["playback"] == 0 and d["presentation"]["bounds"] is None'
expect_document 0 info stated.l4d
expect_json out 'd["rendering"]["stated"] and d["rendering"]["dilation"] == 2'
expect_json out 'd["rendering"]["compensation"] and d["presentation"]["playback"] == 2'
expect_json out 'd["presentation"]["camera"]["position"] == [0, 1, 5]'
expect 0 info stated.l4d
expect_text out '^rendering: dilation=2,compensation=1$'

# What people are told, too, and no terminal by itself.
expect 0 encode s.ply -o told.l4d --metadata $'by=\xc3\xa4 "b"' --metadata $'bell=\a\e[2J'
expect_document 0 info told.l4d
expect_json out 'd["metadata"] == [{"key": "by", "value": "\u00e4 \"b\""}, {"key": "bell", "value": "\a\x1b[2J"}]'
expect 0 info told.l4d
expect_text out '^metadata: "by" "ä ."b.""$'
expect_text out '^metadata: "bell" ".u0007.u001b.2J"$'

# Attributes are the same bits; pictures are not.
expect 0 decode --digest plain.l4d
cp out plain.digest
expect 0 decode --digest stated.l4d
cmp out plain.digest || die "a statement changes attributes"
expect 0 render plain.l4d --cameras c.json --time 1 -o plain.png
expect 0 render stated.l4d --cameras c.json --time 1 -o stated.png
cmp -s plain.png stated.png && die "the statement is not obeyed"

# The same way back, also where the stream's options come from a PLY.
expect 0 decode stated.l4d -o back.ply
expect 0 encode back.ply -o again.l4d --preset lossless
expect_document 0 info again.l4d
expect_json out 'd["rendering"]["dilation"] == 2 and d["presentation"]["playback"] == 2'
expect 0 render back.ply --cameras c.json --time 1 -o back.png
cmp -s plain.png back.png && die "a PLY's statement is not obeyed"
# An option changes what it names and keeps the rest.
expect 0 encode back.ply -o mixed.l4d --rendering cutoff=3
expect_document 0 info mixed.l4d
expect_json out 'd["rendering"]["dilation"] == 2 and d["rendering"]["cutoff"] == 3'

# What is wrong is told before the scene is read.
for bad in dilation=17 dilation size=1 max_alpha=1; do
  expect 2 encode s.ply -o bad.l4d --rendering "$bad"
  expect_text err '--rendering'
done
expect 2 encode s.ply -o bad.l4d --presentation playback=often
expect_text err '--presentation: playback'
[[ ! -e bad.l4d ]] || die "an output of a failed command"
sed 's/l4d_rendering .*/l4d_rendering dilation=99/' back.ply > broken.ply
expect 4 encode broken.ply -o bad.l4d
expect_text err 'l4d_rendering'

# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# Where output goes, and what is never overwritten.
make_scene s.ply 800

# No input, or none that is a file.
expect_document 3 info missing.l4d
expect_document 3 decode . -o x.ply
expect_document 5 encode . -o x.l4d # a folder is one of frames, and s.ply is none
expect_document 3 encode s.ply -o nowhere/x.l4d
expect_missing x.l4d

# Names derived from the input.
mkdir d
cp s.ply d/scene.ply
expect 0 encode d/scene.ply --preset lossless
[ -s d/scene.l4d ] || die "no d/scene.l4d"

# Overwriting needs --force; the input never is.
cp d/scene.l4d before
expect 3 encode d/scene.ply --preset lossless
expect_text err '--force'
cmp before d/scene.l4d
expect 3 decode d/scene.l4d
expect 0 decode d/scene.l4d -o decoded.ply
expect 3 decode d/scene.l4d -o decoded.ply
expect 0 decode d/scene.l4d -o decoded.ply --force
expect 2 encode s.ply -o s.ply --force
expect 2 decode d/scene.l4d -o ./d/../d/scene.l4d --force
expect 0 synth --scene cloud -n 100 -o small.ply
expect 3 synth --scene cloud -n 100 -o small.ply
expect 3 slice s.ply --time 1 -o small.ply
expect 3 encode s.ply -o fresh.l4d --order small.ply
expect_missing fresh.l4d

# Nothing but the output appears: no temporary stays, on success or failure.
mkdir clean
cp s.ply clean/
expect 0 encode clean/s.ply -o clean/s.l4d --preset lossless --order clean/s.order
expect 0 slice clean/s.l4d --time 0.5 -o clean/f.ply
head -c 20000 s.ply > cut.ply
expect 4 encode cut.ply -o clean/cut.l4d
head -c 30000 clean/s.l4d > cut.l4d
expect 4 decode cut.l4d -o clean/cut.ply
expect_equal "$(cd clean && echo *)" "f.ply s.l4d s.order s.ply"

# stdin and stdout.
l4d encode - -o - --preset lossless < s.ply > piped.l4d 2> err
cmp piped.l4d clean/s.l4d
expect_text err 'bits per Gaussian'
l4d decode - -o - < piped.l4d 2> err | cmp - decoded.ply
# shellcheck disable=SC2002  # a pipe, not a file
cat s.ply | l4d compare - piped.l4d --exact > out
expect 2 encode s.ply -o - --json
expect_text out '"USAGE"'
expect 2 encode - < s.ply
expect 2 slice s.ply --from 0 --to 1 -o -

# A device is written to, not replaced.
expect 0 encode s.ply -o /dev/null --preset lossless
[ -c /dev/null ] || die "/dev/null was replaced"
if [ -c /dev/full ]; then
  expect 3 encode s.ply -o /dev/full --preset lossless
  status=0
  l4d version > /dev/full 2> err || status=$?
  expect_equal "$status" 3
fi

# --quiet: silence, but for errors.
expect 0 encode s.ply -o quiet.l4d --preset lossless --quiet
expect_empty out
expect_empty err
expect 3 info missing.l4d --quiet
expect_equal "$(wc -l < err)" 1

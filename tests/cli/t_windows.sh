# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# Flat windows: a scene that is made anew in each frame, from PLY to stream, slices and pictures.
expect_document 0 synth --scene cloud -n 3000 --seconds 1 --fps 30 --effects frames -o f.ply
expect_json out 'd["effects"] == ["frames"]'
expect_document 0 encode f.ply -o f.l4d --order f.order
expect_document 0 info f.l4d
expect_json out '"flat-windows" in d["tools"] and "flat-windows" in d["layers"][0]["tools"]'
expect 0 info f.l4d
expect_text out 'flat-windows +. of . layers show each Gaussian in a range of frames'
expect 0 validate f.l4d

# Each frame shows its 100 Gaussians, at its beginning and until its end.
for k in 0 1 7 14 28 29; do
  for part in 0 0.4 0.99; do
    t=$("$PYTHON" -c "print(repr(($k + $part) / 30))")
    expect_document 0 slice f.l4d --time "$t" -o s.ply --force
    expect_json out 'd["frames"][0]["gaussians"] == 100'
  done
done
expect_document 0 slice f.l4d --time 1 -o s.ply --force
expect_json out 'd["frames"][0]["gaussians"] == 100'

# Windows come back as they were, as PLY and as arrays, and are digested.
expect 0 decode f.l4d -o back.ply
expect 0 encode back.ply -o again.l4d --preset lossless
expect 0 encode f.ply -o lossless.l4d --preset lossless --order lossless.order
expect 0 validate lossless.l4d
expect 0 decode f.l4d --digest
expect_equal "$(wc -l < out)" 11
expect_text out '^[0-9a-f]{16}  window u32 \[3000, 2\]$'
grep ' window ' out > windows
expect 0 decode again.l4d --digest
expect_text out ' window u32 \[3000, 2\]$'
expect 0 decode f.l4d --digest --backend reference
grep ' window ' out | cmp windows

# Another decoder has the same bits of it.
expect 0 synth --scene cloud -n 240 --seconds 1 --effects frames,rigid,static -o small.ply
for preset in default indexed; do
  profile=-1
  [ "$preset" != indexed ] || profile=1
  expect 0 encode small.ply -o small.l4d --force --preset $preset --set profile=$profile --set merge-count=0 --set merge-fraction=0
  for query in all time:0.4666666666666667 range:0.1:0.2; do
    case $query in
      all) options='' ;;
      time:*) options="--time ${query#time:}" ;;
      *) options='--from 0.1 --to 0.2' ;;
    esac
    # shellcheck disable=SC2086
    expect_document 0 decode small.l4d --digest $options
    json out 'd["digests"]["all"]' > own
    "$PYTHON" -B "$ROOT/conformance/reference/l4d.py" --query "$query" small.l4d > out
    expect_equal "$(json out 'd["digests"]["all"]')" "$(cat own)"
    expect_json out '"window" in d["digests"]'
  done
done
expect_document 0 decode small.l4d --digest --packed
json out 'd["digests"]["all"]' > own
"$PYTHON" -B "$ROOT/conformance/reference/l4d.py" --packed small.l4d > out
expect_equal "$(json out 'd["digests"]["all"]')" "$(cat own)"
"$PYTHON" -B "$ROOT/conformance/reference/l4d.py" --query validate small.l4d > out
expect_json out 'd["valid"]'

# Pictures of the stream against pictures of the PLY, as other scenes are compared.
expect_document 0 compare f.ply f.l4d --order f.order --max-error opacity=0.02
expect_json out 'd["matched"] == 3000'
if l4d render --help > /dev/null 2>&1; then
  expect 0 compare f.ply f.l4d --orbit 4 --size 160x90 --frames 0:30:9 --min-fidelity 35
fi

# Beside other effects, and absent without them.
expect 0 synth --scene cloud -n 4000 --seconds 2 --effects static,rigid,appear,frames -o m.ply
for preset in default indexed lossless tiny; do
  expect 0 encode m.ply -o m.l4d --force --preset $preset
  expect 0 validate m.l4d
done
expect 0 synth --scene cloud -n 1000 -o all.ply
expect 0 encode all.ply -o all.l4d
expect_document 0 info all.l4d
expect_json out '"flat-windows" not in d["tools"]'

# What is no window is named, or dropped.
"$PYTHON" - << 'PYTHON'
import re, struct
data = open("f.ply", "rb").read()
end = data.index(b"end_header\n") + 11
names = re.findall(rb"property float (\w+)\n", data[:end])
assert names[-2:] == [b"window_begin", b"window_end"], names
row = 4 * len(names)
bad = bytearray(data)
bad[end + 8 * row - 4:end + 8 * row] = struct.pack("<f", 31)
open("bad.ply", "wb").write(bad)
PYTHON
expect 4 encode bad.ply -o bad.l4d
expect_text err 'Gaussian 7 has an invalid window'
expect 0 encode bad.ply -o bad.l4d --drop-invalid
expect 5 decode f.l4d -o x.ply --format ftgs
expect_text err 'ftgs_ply has no flat windows; .ply and .4dgs have'

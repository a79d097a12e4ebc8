# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# What concat, cut, repair, manifest, info and validate do at the edges: times that are sums, damaged
# headers, streams without an end, claims of several members, and where messages point.
make_scene s.ply 3k
expect 0 encode s.ply -o s.l4d
spans() { # FILE: begin, end of each media member
  json <(l4d info "$1" --json) '[(m["begin"], m["end"]) for m in d["members"] if m["role"] == "media"]'
}

# Spans that follow each other do so without a gap, however often they are moved; where no sum of
# binary64 is the end of the one before, the next number is.
expect 0 cut s.l4d --from 1.36 --to 1.91 -o first.l4d
expect 0 cut s.l4d --from 0.45 --to 1.81 -o second.l4d
expect 0 cut s.l4d --from 0.7 --to 1.39 -o third.l4d
expect 0 concat first.l4d second.l4d third.l4d -o once.l4d
expect 0 concat once.l4d once.l4d -o twice.l4d
expect 0 concat twice.l4d once.l4d s.l4d twice.l4d --begin 0.1 -o often.l4d
for file in once twice often; do
  expect_document 0 validate $file.l4d
  expect_json out 'd["valid"]'
  "$PYTHON" -c 'import math, sys
spans = eval(sys.argv[1])
gaps = [b[0] - a[1] for a, b in zip(spans, spans[1:])]
assert len(gaps) >= 2 and all(0 <= g <= math.ulp(b[0]) for g, b in zip(gaps, spans[1:])), spans
assert gaps.count(0) >= len(gaps) // 2, spans' \
    "$(spans $file.l4d)" || die "$file.l4d has gaps"
done
expect_json <(l4d info often.l4d --json) '0 <= d["members"][0]["begin"] - 0.1 < 1e-15'
# Whole seconds stay whole ones.
expect 0 cut s.l4d --to 1 -o a.l4d
expect 0 cut s.l4d --from 1 -o b.l4d
expect 0 concat b.l4d a.l4d b.l4d --begin 0 -o bab.l4d
expect_equal "$(spans bab.l4d)" "[(0.0, 1.0), (1.0, 2.0), (2.0, 3.0)]"
expect 0 concat bab.l4d bab.l4d -o long.l4d
expect_equal "$(spans long.l4d)" "[(0.0, 1.0), (1.0, 2.0), (2.0, 3.0), (3.0, 4.0), (4.0, 5.0), (5.0, 6.0)]"
# A member that is in the part by a rounding only is no part of it.
border=$(json <(l4d info twice.l4d --json) 'repr(d["members"][2]["end"])')
above=$(json <(l4d info twice.l4d --json) 'repr(d["members"][2]["end"] * (1 + 1e-15))')
below=$(json <(l4d info twice.l4d --json) 'repr(d["members"][2]["end"] * (1 - 1e-15))')
for at in "$border" "$above" "$below"; do
  expect_document 0 cut twice.l4d --from "$at" -o part.l4d -f
  expect_json out 'd["num_members"] == 3'
  expect_document 0 cut twice.l4d --to "$at" -o part.l4d -f
  expect_json out 'd["num_members"] == 3'
done
# Times that are limited are noted.
expect_document 0 cut s.l4d --to 100 -o limited.l4d
expect_json out 'd["end"] == 2 and any("--to 100 lies outside" in n for n in d["notes"])'

# Every member is held against what is claimed.
expect 0 encode s.ply -o raw.l4d --preset lossless
expect 0 concat s.l4d raw.l4d -o mixed.l4d
expect_document 0 validate mixed.l4d
expect_json out 'd["conformance"]["profile"] is None and d["conformance"]["holds"]'
expect_json out '[m["conformance"]["profile"] for m in d["conformance"]["members"]] == ["main", "lossless"]'
expect_document 1 validate mixed.l4d --profile main
expect_json out 'd["valid"] and [v["clause"] for v in d["conformance"]["violations"]] != []'
expect_document 0 validate bab.l4d --profile main --level phone
expect_json out 'd["conformance"]["level"] == 1 and len(d["conformance"]["members"]) == 3'
l4d synth --scene cloud -q -n 101k --seconds 1 --fps 1 --effects static,rigid --seed 9 -o large.ply
expect 0 encode large.ply -o large.l4d -e 1 --preset tiny
expect 0 concat s.l4d large.l4d -o sizes.l4d
expect_document 1 validate sizes.l4d --level 1
expect_json out 'd["conformance"]["level"] == 2 and not d["conformance"]["holds"]'
expect_json out '[(q["value"], q["member"]) for q in d["conformance"]["quantities"]
  if q["name"] == "instant_gaussians"] == [(101000, 1)]'

# A playlist is text; its address is the way from its folder to the file.
expect_document 0 manifest bab.l4d
expect_json out 'd["output"] is None and d["playlist"].startswith("#EXTM3U") and "bab.l4d" in d["playlist"]'
"$PYTHON" - "$L4DCODEC" << 'PY' || die "no playlist at a terminal"
import os, pty, subprocess, sys
ours, theirs = pty.openpty()
done = subprocess.run([sys.argv[1], "manifest", "bab.l4d"], stdout=theirs, stderr=subprocess.PIPE)
assert done.returncode == 0, done.stderr
assert os.read(ours, 7) == b"#EXTM3U"
PY
mkdir -p lists/deep
expect 0 manifest bab.l4d -o lists/deep/bab.m3u8
expect_text lists/deep/bab.m3u8 '^\.\./\.\./bab\.l4d$'
expect_text out '3 members'

cp bab.l4d 'a&b.l4d'
expect 0 manifest 'a&b.l4d' -o escaped.m3u8
expect_text escaped.m3u8 '^a%26b\.l4d$'
expect 0 encode --live s.ply --segment 0.4 -o live.l4d
head -c $(($(wc -c < live.l4d) - 100)) live.l4d > growing.l4d
expect_document 0 manifest growing.l4d
expect_json out '"#EXT-X-ENDLIST" not in d["playlist"] and not d["complete"]'
expect_document 0 manifest live.l4d
expect_json out '"#EXT-X-ENDLIST" in d["playlist"] and d["complete"]'

# A stream that does not say where it ends has all that follows.
cat s.l4d s.l4d > joined.l4d
size=$(wc -c < s.l4d)
for command in info validate manifest; do
  expect_document 0 $command joined.l4d
  expect_json out "any(format($size, ',') + ' bytes belong to no chunk' in n for n in d['notes'])"
  expect_document 0 $command s.l4d
  expect_json out 'd["notes"] == []'
done
expect_document 0 info bab.l4d
expect_json out 'sum(d["sections"].values()) == d["stream_bytes"]'

# The index finds what lies behind a damaged header.
for member in 0 1; do
  at=$(json <(l4d info bab.l4d --json) "d['members'][$member]['offset']")
  cp bab.l4d damaged.l4d
  printf '\x55\xaa' | dd of=damaged.l4d bs=1 seek=$((at + 20)) conv=notrunc 2> /dev/null
  expect_document 0 repair damaged.l4d -o rest.l4d -f
  expect_json out "d['kept'] == [n for n in range(3) if n != $member] and d['rest'] is None"
  expect_document 0 validate rest.l4d
  expect_json out 'd["valid"]'
  expect 0 repair damaged.l4d -o rest.l4d -f
  expect_text out '2 members kept, 1 left out'
done
# With an index the others are shown, and what is damaged is named.
make_cameras cameras.json
for member in 0 1; do
  at=$(json <(l4d info bab.l4d --json) "d['members'][$member]['offset']")
  cp bab.l4d damaged.l4d
  printf '\x55\xaa' | dd of=damaged.l4d bs=1 seek=$((at + 60)) conv=notrunc 2> /dev/null
  for other in 0 1 2; do
    time=$(json <(l4d info bab.l4d --json) "d['members'][$other]['begin'] + 0.01")
    if [ $other = $member ]; then
      expect 4 slice damaged.l4d --time "$time" --digest
      expect_text err "damaged.l4d: member $member, which begins at byte $at: spec FILE-6"
      expect 4 render damaged.l4d --time "$time" --size 16x16 -o x.png
      expect_document 0 slice damaged.l4d --time "$time" --digest --tolerant
      expect_json out "d['frames'][0]['gaussians'] == 0 and any('member $member, which' in n for n in d['notes'])"
      # An image of the background.
      expect_document 0 render damaged.l4d --time "$time" --cameras cameras.json --tolerant -o empty.png -f \
        --background 0,1,0
      expect_json out "d['visible'] == 0 and any('member $member, which' in n for n in d['notes'])"
      "$PYTHON" -c 'import zlib
data = open("empty.png", "rb").read()
at = data.index(b"IDAT")
row = zlib.decompressobj().decompress(data[at + 4:at + 4 + int.from_bytes(data[at - 4:at], "big")])
assert row[1:4] == bytes([0, 255, 0]), row[:4]' || die "the image is not of the background"
    else
      expect_equal "$(json <(l4d slice damaged.l4d --time "$time" --digest --json) 'd["frames"][0]["digests"]')" \
        "$(json <(l4d slice bab.l4d --time "$time" --digest --json) 'd["frames"][0]["digests"]')"
      expect 0 render damaged.l4d --time "$time" --cameras cameras.json -o ok.png -f
    fi
  done
done
# Of a standing member the pages stay that are right: what is shown is what a tolerant decoder shows.
l4d synth --scene cloud -q -n 4k --seconds 6 --fps 30 --seed 2 -o six.ply
expect 0 encode --live six.ply --segment 1 --set page-size=256 -o six.l4d
expect_document 0 info six.l4d
expect_json out 'd["members"][-1]["begin"] is None and d["members"][0]["role"] == "standing"'
bytes=$(json out 'd["members"][0]["bytes"]')
standing=$(json <(l4d cut six.l4d --member 0 -o - | l4d info - --json) 'd["num_gaussians"]')
cp six.l4d hurt.l4d
printf '\x55\xaa' | dd of=hurt.l4d bs=1 seek=$((bytes - 500)) conv=notrunc 2> /dev/null
expect_document 0 repair hurt.l4d -o rest.l4d -f
expect_json out 'd["kept"] == list(range(7)) and d["dropped"] == d["incomplete"] == []'
expect_json out '[m["number"] for m in d["partial"]] == [0] and "CHNK-2" in d["partial"][0]["reason"]'
expect_json out "d['partial'][0]['num_gaussians'] + d['partial'][0]['lost_gaussians'] == $standing"
expect_json out '0 < d["partial"][0]["lost_gaussians"] <= 256'
expect_document 0 validate rest.l4d
for time in 0.5 2.5 5; do
  expect_equal "$(json <(l4d slice rest.l4d --time $time --digest --json) 'd["frames"][0]["digests"]["all"]')" \
    "$(json <(l4d slice hurt.l4d --time $time --digest --tolerant --json) 'd["frames"][0]["digests"]["all"]')"
done
# Of one whose headers are wrong nothing stays. What needs it does.
cp six.l4d hurt.l4d
printf '\x55\xaa' | dd of=hurt.l4d bs=1 seek=60 conv=notrunc 2> /dev/null
expect_document 0 repair hurt.l4d -o rest.l4d -f
expect_json out '[m["number"] for m in d["dropped"]] == [0] and d["kept"] == d["incomplete"] == [1, 2, 3, 4, 5, 6]'
expect_json out 'd["partial"] == []'
expect_document 0 validate rest.l4d
expect_document 0 slice rest.l4d --time 2.5 --digest
# One stream is repaired as a member is, whether a byte of it is wrong or its end is gone.
expect 0 encode six.ply --set page-size=256 -o one.l4d
cp one.l4d hurt.l4d
printf '\x55\xaa' | dd of=hurt.l4d bs=1 seek=$(($(wc -c < one.l4d) - 500)) conv=notrunc 2> /dev/null
head -c $(($(wc -c < one.l4d) * 3 / 4)) one.l4d > short.l4d
for file in hurt short; do
  expect_document 0 repair $file.l4d -o rest.l4d -f
  expect_json out 'd["kept"] == [0] and 0 < d["partial"][0]["num_gaussians"] < 4000'
  left=$(json out 'd["partial"][0]["num_gaussians"]')
  expect_document 0 validate rest.l4d
  expect_document 0 decode $file.l4d --tolerant --digest
  expect_json out "d['num_gaussians'] == $left"
done
expect 0 repair short.l4d -o rest.l4d -f
expect_text out '1 member kept, 1 of them in part'
expect_text err 'kept without [0-9,]+ of its 4,000 Gaussians, which are in damaged pages: spec CHNK-1.* behind the end'
# What goes to a device is counted too.
expect_document 0 cut one.l4d --from 1 --to 2 -o /dev/null
expect_json out 'd["file_bytes"] > 1000'
# A page of which only SH detail is wrong keeps its Gaussians, which show base colours.
l4d synth --scene cloud -q -n 12k --seconds 2 --seed 5 -o detail.ply
expect 0 encode detail.ply -o detail.l4d
cp detail.l4d hurt.l4d
printf '\x55\xaa' | dd of=hurt.l4d bs=1 seek=$(($(wc -c < detail.l4d) - 500)) conv=notrunc 2> /dev/null
expect_document 0 slice hurt.l4d --time 1 --tolerant --digest
expect_json out '[l["detail_only"] for l in d["losses"]] == [True]'
geometry='[a["digest"] for a in d["frames"][0]["digests"]["arrays"] if a["name"] != "sh"]'
shown=$(json out "$geometry")
expect 0 repair hurt.l4d -o rest.l4d -f
expect_text err 'member 0 is kept without SH detail of damaged pages, which show base colours: spec CHNK-2'
expect_document 0 repair hurt.l4d -o rest.l4d -f
expect_json out 'd["partial"][0]["lost_gaussians"] == 0 and d["partial"][0]["num_gaussians"] == 12000'
expect_document 0 validate rest.l4d
expect_document 0 slice rest.l4d --time 1 --digest
expect_equal "$(json out "$geometry")" "$shown"
# Where only the standing member is whole, commands say so.
head -c $((bytes + 100)) six.l4d > standing.l4d
expect_document 0 slice standing.l4d --time 1 --digest
expect_json out 'any("no media member" in n for n in d["notes"])'
expect_document 0 manifest standing.l4d
expect_json out 'any("no segment" in n for n in d["notes"])'
cp bab.l4d damaged.l4d
printf '\x55' | dd of=damaged.l4d bs=1 seek=20 conv=notrunc 2> /dev/null
expect 4 info damaged.l4d
expect_text err 'damaged.l4d: spec FILE-4.*members 0 .*, 1 .*repair'
# Members of a file are one scene: one placement, one rendering.
expect 0 encode s.ply --rendering dilation=0.1 -o drawn.l4d
expect 2 concat s.l4d drawn.l4d -o x.l4d
expect_text err 'drawn.l4d has another rendering than s.l4d'
expect_missing x.l4d
# Messages name the file.
for command in "cut --to 1" concat remux; do
  # shellcheck disable=SC2086
  expect 4 $command damaged.l4d -o x.l4d
  expect_text err 'damaged\.l4d: spec'
done
head -c 20 s.l4d > short.l4d
expect 4 repair short.l4d -o x.l4d
expect_text err 'short.l4d: spec FILE-1'
expect 4 manifest short.l4d
expect_text err 'short.l4d: spec FILE-1'
expect 0 info bab.l4d
expect_text out '^0 +media .* -$'

# A file that must not grow names no input.
status=0
(
  ulimit -f 4
  l4d cut s.l4d --to 1 -o x.l4d
) > out 2> err || status=$?
expect_equal "$status" 3
expect_text err 'cannot write a temporary file: File too large'
expect_missing x.l4d

# A stream is as it is.
expect_document 0 compare s.l4d s.l4d --exact
expect_json out 'all(a["max"] == 0 for a in d["attributes"].values())'
expect_json out 'd["visible_position"]["max"] == 0 and d["seen"]["seen_opacity"]["max"] == 0'

# Signatures are of bytes that change.
if l4d keygen -o own.key > out 2> err; then
  expect 0 sign bab.l4d -o signed.l4d --key own.key
  for command in "cut --from 1" concat remux repair; do
    # shellcheck disable=SC2086
    expect_document 0 $command signed.l4d -o x.l4d -f
    expect_json out 'any("signature of signed.l4d" in n for n in d["notes"])'
  done
fi

# A file whose times leave nothing of it but a rounding is at fault, and not who cuts it.
"$PYTHON" - << 'EOF'
import re
head, body = open("s.ply", "rb").read().split(b"end_header\n", 1)
head = re.sub(r"time_begin \S+", "time_begin 4e15", head.decode())
head = re.sub(r"time_end \S+", "time_end 4000000000000020", head)
open("far.ply", "wb").write(head.encode() + b"end_header\n" + body)
EOF
expect 0 encode far.ply -o far.l4d
for part in '--to 5e15' '--from 0' '--member 0'; do
  # shellcheck disable=SC2086
  expect 4 cut far.l4d $part -o x.l4d -f
  expect_text err 'far.l4d is from 4e\+15 to 4e\+15 s: no longer than a rounding of such times'
done
expect 2 cut far.l4d --from 1 --to 2 -o x.l4d -f

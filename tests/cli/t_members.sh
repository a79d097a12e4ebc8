# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# concat, cut, repair and manifest: what files of several streams show, and what is left of broken ones.
make_scene s.ply 4k
expect 0 encode s.ply -o s.l4d
end=$(json <(l4d info s.l4d --json) 'd["duration_s"]')
digest_at() { # FILE TIME: of the slice at an instant
  json <(l4d slice "$1" --time "$2" --digest --json) 'd["frames"][0]["digests"]["all"]'
}

# Pieces show what the whole shows, and are no larger.
expect_document 0 cut s.l4d -o a.l4d --to 1
expect_json out 'd["begin"] == 0 and d["end"] == 1 and d["num_members"] == 1'
expect_document 0 cut s.l4d -o b.l4d --from 1 --to 1.7
expect_document 0 cut s.l4d -o c.l4d --from 1.7
expect_json out "d['end'] == $end"
for piece in a:0.5 b:1 b:1.3 b:1.69 c:1.7 c:1.95; do
  expect_equal "$(digest_at "${piece%:*}.l4d" "${piece#*:}")" "$(digest_at s.l4d "${piece#*:}")"
done
for piece in a b c; do
  expect_document 0 validate $piece.l4d
  expect_json out 'd["valid"]'
done

# Chained again they are one file of three members and an index, at the times that they had.
expect_document 0 concat a.l4d b.l4d c.l4d -o abc.l4d
expect_json out "d['num_members'] == 3 and d['begin'] == 0 and d['end'] == $end"
expect_document 0 validate abc.l4d
expect_document 0 info abc.l4d
cp out listed
expect_json listed '[m["role"] for m in d["members"]] == ["media"] * 3 + ["index"]'
expect_json listed '[m["begin"] for m in d["members"][:3]] == [0, 1, 1.7]'
expect_json listed 'all(m["shift"] == 0 for m in d["members"]) and d["members_rest"] is None'
expect 0 info abc.l4d
expect_text out '^member +role'
"$PYTHON" -B - "$ROOT" abc.l4d << 'PY' || die "the reference decoder finds other members"
import json, sys
sys.path.insert(0, sys.argv[1] + "/conformance/reference")
from members import check_index, members
found = list(members(open(sys.argv[2], "rb").read()))
check_index(found)
listed = json.load(open("listed"))["members"]
assert [(m.offset, len(m.data), *m.span) for m in found[:3]] == [
    (m["offset"], m["bytes"], m["begin"], m["end"]) for m in listed[:3]]
PY
# Each member is a stream of its own that decodes to what the piece decodes to.
offset=$(json listed 'd["members"][1]["offset"]')
tail -c +$((offset + 1)) abc.l4d > from_b.l4d
expect_equal "$(digest_at from_b.l4d 1.3)" "$(digest_at s.l4d 1.3)"

# Streams that play one after the other begin where the one before ends.
expect_document 0 concat s.l4d abc.l4d s.l4d -o long.l4d
expect_json out "d['num_members'] == 5 and abs(d['end'] - 3 * $end) < 1e-9"
expect_document 0 validate long.l4d
# Times that are rounded when they are moved again: no span overlaps the one before.
expect 0 cut s.l4d --from 1.36 --to 1.91 -o first.l4d
expect 0 cut s.l4d --from 0.45 --to 1.81 -o second.l4d
expect 0 cut s.l4d --from 0.7 --to 1.39 -o third.l4d
expect 0 concat first.l4d second.l4d third.l4d -o once.l4d
for _ in 1 2 3; do
  expect 0 concat once.l4d once.l4d -o again.l4d
  expect_document 0 validate again.l4d
  mv again.l4d once.l4d
done
expect 0 concat s.l4d s.l4d -o - < /dev/null
cp out twice.l4d
expect 0 validate - < twice.l4d

# A part of several members.
expect_document 0 cut abc.l4d -o mid.l4d --from 0.5 --to 1.5
expect_json out 'd["num_members"] == 2 and (d["begin"], d["end"]) == (0.5, 1.5)'
expect_document 0 validate mid.l4d
expect_document 0 info mid.l4d
expect_json out '[(m["begin"], m["end"]) for m in d["members"][:2]] == [(0.5, 1), (1, 1.5)]'
expect_document 0 cut abc.l4d -o last.l4d --from 1.8
expect_json out 'd["num_members"] == 1'
expect_document 0 validate last.l4d

# slice and render show all streams of a file; pieces that are chained show what the whole shows.
for time in 0 0.5 1 1.3 1.69 1.7 1.95 2; do
  expect_equal "$(digest_at abc.l4d $time)" "$(digest_at s.l4d $time)"
done
l4d slice s.l4d --from 0 --fps 9 --digest --json > whole.json
l4d slice abc.l4d --from 0 --fps 9 --digest --json > chained.json
expect_equal "$(json chained.json '[f["digests"] for f in d["frames"]]')" \
  "$(json whole.json '[f["digests"] for f in d["frames"]]')"
expect_equal "$(digest_at twice.l4d 2.5)" "$(digest_at s.l4d 0.5)"
expect_document 0 slice abc.l4d --time 7 --digest
expect_json out 'd["frames"][0]["time"] == 2 and any("outside the sequence" in n for n in d["notes"])'
for path in fast reference; do
  expect 0 render s.l4d --range 0: --fps 3 --orbit --size 48x32 --path $path -o s_%d.png -f
  expect 0 render abc.l4d --range 0: --fps 3 --orbit --size 48x32 --path $path -o abc_%d.png -f
  for frame in 0 1 2 3 4 5; do
    cmp s_$frame.png abc_$frame.png || die "frame $frame of the pieces looks different"
  done
done
expect 0 render twice.l4d --range 1.9:2.1 --fps 20 --size 48x32 -o border_%d.png
expect_document 0 slice abc.l4d --time 1.2 --tolerant --detail base --digest
# Commands that read one stream say what they leave, and one member is a stream.
expect_document 0 decode abc.l4d --digest
expect_json out 'any("3 streams" in n for n in d["notes"])'
expect_json out 'any("presents 0 to 1 s" in n for n in d["notes"])'
expect_document 0 decode b.l4d --digest
expect_json out 'len(d["notes"]) == 1 and "presents 1 to 1.7 s" in d["notes"][0]'
expect_document 0 decode s.l4d --digest
expect_json out 'd["notes"] == []'
expect_document 0 cut abc.l4d --member 1 -o one.l4d
expect_json out '(d["begin"], d["end"]) == (1, 1.7)'
cmp one.l4d b.l4d || die "a member is not the piece that it was"
expect 2 cut abc.l4d --member 9 -o x.l4d
expect_text err 'no member 9'

# A file of one stream is shown at the times that it presents, too: a part, and a part that is moved.
expect 0 concat b.l4d --begin 10 -o moved.l4d
expect_equal "$(digest_at moved.l4d 10.3)" "$(digest_at s.l4d 1.3)"
expect_equal "$(json <(l4d slice b.l4d --from 0 --digest --json) 'd["frames"][0]["time"]')" 1.0
for file in b moved; do
  begin=$(json <(l4d info $file.l4d --json) 'd["members"][0]["begin"]')
  expect_document 0 render $file.l4d --range 0: --size 32x24 -o ${file}_%d.png
  expect_json out "d['frames'] == 21 and d['time_begin'] == $begin"
  cmp ${file}_9.png b_9.png
  expect_document 0 slice $file.l4d --time 0 --digest
  expect_json out "d['frames'][0]['time'] == $begin"
done
expect_document 0 compare b.l4d moved.l4d --orbit 2 --size 32x24
expect_json out 'not d["timeline_equal"]'
expect 0 decode moved.l4d --digest
expect_text err 'presents its sequence 9 s later'
# What is coded again has the times of the presentation.
expect 0 encode moved.l4d --preset lossless -o coded.l4d
expect_document 0 info coded.l4d
expect_json out '(d["time_begin"], d["num_frames"]) == (10, 21)'
expect 0 encode b.l4d --preset lossless -o coded_b.l4d
for time in 0 0.3 0.65; do
  "$PYTHON" - "$(json <(l4d slice coded.l4d --time "$("$PYTHON" -c "print(10 + $time)")" --digest --json) 'd["frames"][0]["gaussians"]')" \
    "$(json <(l4d slice b.l4d --time "$("$PYTHON" -c "print(1 + $time)")" --digest --json) 'd["frames"][0]["gaussians"]')" << 'PY' || die "other Gaussians are shown at $time"
import sys
a, b = map(int, sys.argv[1:])
sys.exit(a == 0 or abs(a - b) > 0.002 * b)
PY
done
expect 0 concat a.l4d b.l4d c.l4d -o all.l4d
for number in 0 1 2; do expect 0 cut all.l4d --member $number -o piece_$number.l4d; done
expect_document 0 encode --live piece_0.l4d piece_1.l4d piece_2.l4d --segment 0.5 -o live.l4d
expect_json out "(d['begin'], d['end']) == (0, $end)"
expect_document 0 validate live.l4d

# A recording that broke off: the whole members stay.
size=$(wc -c < abc.l4d)
third=$(json listed 'd["members"][2]["offset"]')
head -c $((third + 1000)) abc.l4d > broken.l4d
expect 1 validate broken.l4d
expect_text out 'HEAD-21|FILE-1|CHNK-1'
expect_document 0 info broken.l4d
expect_json out 'len(d["members"]) == 2 and d["members_rest"]'
expect 4 concat broken.l4d s.l4d -o x.l4d
expect_text err 'repair'
expect 4 cut broken.l4d --to 1 -o x.l4d
expect_missing x.l4d
expect_document 0 repair broken.l4d -o whole.l4d
expect_json out 'd["kept"] == [0, 1] and d["dropped"] == [] and d["rest_bytes"] == 1000'
expect_document 0 validate whole.l4d
expect_json out 'd["valid"]'
# So does what is whole where a byte in the middle is wrong.
cp abc.l4d damaged.l4d
printf '\x55\xaa' | dd of=damaged.l4d bs=1 seek=$((offset + (third - offset) / 2)) conv=notrunc 2> /dev/null
expect_document 0 repair damaged.l4d -o rest.l4d
expect_json out 'd["kept"] == [0, 2] and [m["number"] for m in d["dropped"]] == [1]'
expect_document 0 validate rest.l4d
expect_json out 'd["valid"]'
# In the hole that it leaves, the nearest instant is shown and not in silence.
expect_document 0 slice rest.l4d --time 1.6 --digest
expect_json out 'sum("between the streams of the file: 1;" in n for n in d["notes"]) == 1'
expect_equal "$(digest_at rest.l4d 1.6)" "$(digest_at rest.l4d 1.7)"
cp abc.l4d damaged_end.l4d
printf '\x55\xaa' | dd of=damaged_end.l4d bs=1 seek=$((size - 1500)) conv=notrunc 2> /dev/null
expect_document 0 repair damaged_end.l4d -o rest_end.l4d
# These bytes are SH detail, without which the member shows base colours.
expect_json out 'd["kept"] == [0, 1, 2] and d["dropped"] == [] and [m["number"] for m in d["partial"]] == [2]'
expect_document 0 validate rest_end.l4d
expect_json out 'd["valid"]'
expect_document 0 repair abc.l4d -o again.l4d
cmp again.l4d abc.l4d || die "repair changes a whole file"
head -c 100 s.l4d > short.l4d
expect 4 repair short.l4d -o x.l4d
expect_missing x.l4d

# The same in the streamable layout, with less of the Gaussians.
expect 0 encode s.ply -o tiers.l4d --tiers 0.2,0.5
expect_document 0 remux tiers.l4d -o lean.l4d --max-tier 1
expect_json out 'd["file_bytes"] < d["input_bytes"] and d["num_members"] == 1'
expect_document 0 validate lean.l4d
expect_json out 'd["valid"]'
expect_equal "$(json <(l4d decode lean.l4d --digest --json) 'd["digests"]["all"]')" \
  "$(json <(l4d decode tiers.l4d --max-tier 1 --digest --json) 'd["digests"]["all"]')"
expect_document 0 remux abc.l4d -o remuxed.l4d
expect_json out 'd["num_members"] == 3'
cmp remuxed.l4d abc.l4d || die "remux changes what is streamable"
expect_document 0 remux abc.l4d -o coarse.l4d --max-level 0
expect_document 0 validate coarse.l4d
expect_json out 'd["valid"]'

# A playlist: segments are ranges of the file that are streams.
expect_document 0 manifest abc.l4d -o abc.m3u8
expect_json out 'd["complete"] and len(d["members"]) == 4'
"$PYTHON" -B - << 'PY' || die "the playlist does not fit its file"
import re
text = open("abc.m3u8").read().split("\n")
data = open("abc.l4d", "rb").read()
assert text[0] == "#EXTM3U" and text[-2] == "#EXT-X-ENDLIST", text
# Members that were put together have no number in common.
assert not any(line.startswith("#EXT-X-L4D-STREAM") for line in text), text
ranges = [re.fullmatch(r"#EXT-X-BYTERANGE:(\d+)@(\d+)", line) for line in text]
ranges = [(int(m.group(2)), int(m.group(1))) for m in ranges if m]
assert len(ranges) == 3 and all(data[at:at + 4] == b"\x89L4D" for at, _ in ranges)
assert all(a + n == b for (a, n), (b, _) in zip(ranges, ranges[1:]))
assert [line for line in text if line and line[0] != "#"] == ["abc.l4d"] * 3
durations = [float(line[8:-1]) for line in text if line.startswith("#EXTINF:")]
assert durations[:2] == [1.0, 0.7]
PY
expect 0 manifest broken.l4d
expect_text out '^#EXT-X-PLAYLIST-TYPE:EVENT'
expect_text err 'ends before'
cp abc.l4d "a b.l4d"
expect 0 manifest "a b.l4d"
expect_text out '^a%20b.l4d$'
expect 0 manifest abc.l4d --url https://example.org/x.l4d
expect_text out '^https://example.org/x.l4d$'

# Inputs stay, and outputs are not overwritten.
cp s.l4d kept.l4d
expect 2 concat s.l4d a.l4d -o s.l4d
expect 2 cut -f s.l4d --to 1 -o s.l4d
expect 2 repair -f s.l4d -o s.l4d
cmp s.l4d kept.l4d
expect 3 cut s.l4d --to 1 -o a.l4d
expect 2 cut s.l4d -o x.l4d
expect 2 cut s.l4d --from 2 --to 1 -o x.l4d
expect 2 cut s.l4d --from 100 -o x.l4d
expect 2 manifest abc.l4d --url 'a"b'
expect 4 concat s.l4d s.ply -o x.l4d
expect_missing x.l4d
[ "$(wc -c < abc.l4d)" = "$size" ] || die "an input changed"

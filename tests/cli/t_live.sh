# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# encode --live: a scene or pieces as a file that grows, whose whole members play whatever happens.
l4d synth --scene cloud -q -n 6k --seconds 6 --fps 30 --seed 7 -o s.ply

# A scene that is there.
expect_document 0 encode --live s.ply --segment 1 -o live.l4d --playlist live.m3u8
expect_json out 'd["num_media"] == 6 and d["num_standing"] == 1 and d["begin"] == 0 and d["end"] == 6'
expect_json out "d['file_bytes'] == $(stat -c %s live.l4d)"
expect_document 0 validate live.l4d
expect_document 0 info live.l4d
cp out listed
expect_json listed '[m["role"] for m in d["members"]] == ["standing"] + ["media"] * 6 + ["index"]'
expect_json listed 'all(m["needs"] == [0] for m in d["members"] if m["role"] == "media")'
expect 0 manifest live.l4d -o again.m3u8
cmp live.m3u8 again.m3u8
# spec: PLST-3
stream_of() { sed -n 's/^#EXT-X-L4D-STREAM:\([1-9][0-9]*\)$/\1/p' "$1"; }
first=$(stream_of live.m3u8)
[ -n "$first" ] || die 'the playlist states no stream'
make_scene other.ply 300
expect 0 encode --live other.ply --segment 1 -o other.l4d --playlist other.m3u8
[ "$(stream_of other.m3u8)" != "$first" ] || die 'another recording has the same number'
# The same seed gives the same file.
expect 0 encode --live s.ply --segment 1 -o twice.l4d
cmp live.l4d twice.l4d

# What members show together is nearly as good as one stream. Without the bounds on single Gaussians, which
# make positions of one stream finer than the quality asks for, and without views that only the one is measured in.
expect 0 encode s.ply --estimate --set max-position-error=0 -o whole.l4d
expect 0 encode --live s.ply --set max-position-error=0 --segment 2 -o members.l4d
fidelity() { # FILE
  json <(l4d compare s.ply "$1" --orbit 2 --size 160x120 --frames 0:180:15 --json 2> err) "d['fidelity_db']"
}
expect_equal "$("$PYTHON" -c "print($(fidelity members.l4d) > $(fidelity whole.l4d) - 0.8)")" True

# Pieces in their order, and the same pieces in a folder in which they appear.
mkdir parts
for k in 0 1 2; do
  l4d synth --scene cloud -q -n 2k --seconds 2 --fps 30 --seed $((k + 1)) -o "$k.ply"
  "$PYTHON" - "$k.ply" "$k" << 'PY'
import re, struct, sys
head, body = open(sys.argv[1], "rb").read().split(b"end_header\n", 1)
head, body, shift = head.decode(), bytearray(body), 2 * int(sys.argv[2])
names = re.findall(r"property float (\w+)", head)
for k in range(int(re.search(r"element vertex (\d+)", head).group(1))):
    at = 4 * (k * len(names) + names.index("t"))
    struct.pack_into("<f", body, at, struct.unpack_from("<f", body, at)[0] + shift)
head = re.sub(r"(time_begin|time_end) (\S+)", lambda m: f"{m[1]} {float(m[2]) + shift}", head)
open(sys.argv[1], "wb").write(head.encode() + b"end_header\n" + bytes(body))
PY
done
expect_document 0 encode --live 0.ply 1.ply 2.ply -o pieces.l4d
expect_json out 'd["num_pieces"] == 3 and d["num_media"] == 3 and d["end"] == 6'
expect_document 0 validate pieces.l4d
l4d encode --live parts -o folder.l4d --playlist folder.m3u8 --quiet &
encoder=$!
has_segments() { [ "$(grep -c EXTINF folder.m3u8 2> /dev/null)" = "$1" ]; }
for k in 0 1 2; do
  cp "$k.ply" "parts/.$k"
  mv "parts/.$k" "parts/$k.ply"
  wait_for "segment $k" has_segments $((k + 1))
  # What is there plays, while no index is.
  expect_equal "$(grep -c ENDLIST folder.m3u8 || true)" 0
  expect_document 0 info folder.l4d
  expect_json out "sum(m['role'] == 'media' for m in d['members']) == $k + 1"
done
touch parts/end
wait "$encoder"
cmp pieces.l4d folder.l4d
expect_text folder.m3u8 ENDLIST

# Pieces that `cut` makes of one stream, in a folder: what lives on is in each of them, and coded once.
expect 0 encode s.ply -o s.l4d
expect_document 0 encode --live s.l4d --segment 2 -o once.l4d
once=$(json out 'd["file_bytes"]')
mkdir cuts
for k in 0 1 2; do
  expect 0 cut s.l4d --from $((2 * k)) --to $((2 * k + 2)) -o cuts/.next
  mv cuts/.next cuts/piece_$k.l4d
done
touch cuts/end
expect_document 0 encode --live cuts -o cuts.l4d
expect_json out "d['num_pieces'] == 3 and d['file_bytes'] < 1.15 * $once"
expect_document 0 validate cuts.l4d
for time in 0.5 2 5.9; do
  shown=$(json <(l4d slice once.l4d --time $time --digest --json) 'd["frames"][0]["gaussians"]')
  expect_document 0 slice cuts.l4d --time $time --digest
  expect_json out "abs(d['frames'][0]['gaussians'] - $shown) < 0.01 * $shown"
done

# Killed anywhere, every whole member is there, and repair writes the index.
many=(encode --live s.ply --segment 0.2 --preset archive --quiet)
expect 0 "${many[@]}" -o many.l4d
has_bytes() { [ "$(stat -c %s killed.l4d 2> /dev/null)" -ge "$1" ] 2> /dev/null || has_ended "$victim"; }
for percent in 0 20 40 60 80; do
  rm -f killed.l4d
  "$L4DCODEC" "${many[@]}" -o killed.l4d 2> /dev/null &
  victim=$!
  wait_for "$percent % of a file" has_bytes $(($(stat -c %s many.l4d) * percent / 100 + 1))
  kill -9 "$victim" 2> /dev/null || true
  wait "$victim" 2> /dev/null || true
  expect 0 repair killed.l4d -o repaired.l4d --force
  expect 0 validate repaired.l4d
done
# Cut anywhere: as many members as fit.
for n in $("$PYTHON" -c '
import json, random
random.seed(5)
d = json.load(open("listed"))
ends = [m["offset"] + m["bytes"] for m in d["members"]]
print(*[e for e in ends[1:-1]], *[random.randrange(ends[1], ends[-1]) for _ in range(20)])'); do
  head -c "$n" live.l4d > cut.l4d
  expect_document 0 info cut.l4d
  expect_json out "[m['number'] for m in d['members']] == [m['number'] for m in json.load(open('listed'))['members'] if m['offset'] + m['bytes'] <= $n]"
done
# What the file is comes before what its first member is.
expect_json listed 'd["file"]["num_media"] == 6 and d["file"]["num_standing"] == 1 and d["file"]["has_index"]'
expect_json listed 'd["file"]["begin"] == 0 and d["file"]["end"] == 6'
expect_json listed 'd["file"]["num_gaussians"] == sum(m["num_gaussians"] or 0 for m in d["members"]) > d["num_gaussians"]'
expect_json listed 'd["members"][0]["num_gaussians"] == d["num_gaussians"]'
expect_json listed "d['file_bytes'] == $(stat -c %s live.l4d) and d['stream_bytes'] == d['members'][0]['bytes']"
expect 0 info live.l4d
expect_equal "$(head -1 out | sed -E 's/[0-9.]+ kB, [0-9,]+ G/B, N G/')" \
  'live.l4d: 6 media and 1 standing members, 0 to 6 s, B, N Gaussians'
expect_text out '^the first member, 0, of which the rest is \(standing\): l4d 1.0'
! grep -q "no index" out || die "an index is not seen"
head -c "$(json listed 'd["members"][3]["offset"] + 100')" live.l4d > grows.l4d
expect 0 info grows.l4d
expect_text out '^grows.l4d: 2 media and 1 standing members, 0 to 2 s'
expect_text out '^no index: the file may still grow$'
head -c "$(json listed 'd["members"][1]["offset"]')" live.l4d > grows.l4d
expect 0 info grows.l4d
expect_text out '^grows.l4d: 0 media and 1 standing members, no media member yet'

# What cannot be.
expect 5 encode 0.ply 1.ply -o two.l4d
expect_text err '0.ply: a scene that changes over time; a frame of a sequence is a static one'
expect 2 encode s.ply --segment 1 -o two.l4d
expect 2 encode --live s.ply --segment 0 -o two.l4d
expect 2 encode --live s.ply --verify -o two.l4d
expect 2 encode --live s.ply -o -
expect 2 encode --live parts
expect 4 encode --live 1.ply 0.ply -o back.l4d
expect_text err '0.ply: .*begins at 0.*back.l4d ends at 4 s, with the [0-9]+ whole members'
expect_document 0 info back.l4d
expect_json out 'd["members"][-1]["role"] == "index"'
mkdir none
touch none/end
expect 4 encode --live none -o none.l4d

# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# encode --live at the edges: files that were there, second writers, bad pieces, interrupts, full disks.
l4d synth --scene cloud -q -n 3k --seconds 4 --fps 30 --seed 3 -o s.ply
expect 0 encode s.ply -o old.l4d

temporaries() { find . -name '*.l4dtmp*' | grep -q .; }
has_segments() { [ -e "$1" ] && [ "$(grep -c EXTINF "$1")" -ge "$2" ]; }

# The old file is there until the first member of the new one is, and stays where there is none.
cp old.l4d out.l4d
cp old.l4d kept.l4d
printf '#EXTM3U\nold\n' > out.m3u8
mkdir in
expect 3 encode --live in -o out.l4d
"$L4DCODEC" encode --live in -f -o out.l4d --playlist out.m3u8 -q 2> first.err &
first=$!
wait_for "a temporary file" temporaries
cmp out.l4d kept.l4d || die "the old file is gone"
expect_text out.m3u8 old
# One writer at a time: before its first member, and after it.
expect 3 encode --live in -f -o out.l4d
expect_text err 'out.l4d: another process is writing this file'
cp s.ply in/.0
mv in/.0 in/0.ply
wait_for "two segments" has_segments out.m3u8 2
expect 3 encode --live s.ply -f -o out.l4d
expect_text err 'another process is writing this file'
touch in/end
wait "$first"
expect_document 0 validate out.l4d
if temporaries; then die "temporary files are left"; fi
expect 0 encode --live s.ply -f -o out.l4d
expect 0 validate out.l4d
rm in/*
touch in/end
cp old.l4d out.l4d
expect 4 encode --live in -f -o out.l4d --playlist new.m3u8
expect_text err 'without a piece'
cmp out.l4d kept.l4d || die "an old file is gone, and there is no new one"
expect_missing new.m3u8 none.l4d
expect 4 encode --live in -o none.l4d
expect_missing none.l4d

# Pieces as recorders make them: PIECE K SECONDS FPS NAME [SEED]; times are written with 6 digits.
piece() {
  l4d synth --scene cloud -q -n 400 --seconds "$2" --fps "$3" --seed "$((${5:-0} + $1))" -o one.ply -f
  "$PYTHON" - "$1" "$2" "$3" "$4" << 'PY'
import re, struct, sys
k, seconds, fps, name = int(sys.argv[1]), float(sys.argv[2]), float(sys.argv[3]), sys.argv[4]
head, body = open("one.ply", "rb").read().split(b"end_header\n", 1)
head, body, shift = head.decode(), bytearray(body), k * seconds
names = re.findall(r"property float (\w+)", head)
for i in range(int(re.search(r"element vertex (\d+)", head).group(1))):
    at = 4 * (i * len(names) + names.index("t"))
    struct.pack_into("<f", body, at, struct.unpack_from("<f", body, at)[0] + shift)
head = re.sub(r"time_begin \S+", f"time_begin {shift:.6f}", head)
head = re.sub(r"time_end \S+", f"time_end {shift + seconds:.6f}", head)
open(name, "wb").write(head.encode() + b"end_header\n" + bytes(body))
PY
}
gaps() { # FILE: the largest gap between spans
  json <(l4d info "$1" --json) 'max(b["begin"] - a["end"] for a, b in
    zip(*(lambda m: (m, m[1:]))([m for m in d["members"] if m["role"] == "media"])))'
}
for kind in 29.97:1.001 23.976:1.001 30:0.25 30:0.24 25:0.1 30:0.11; do
  for k in 0 1 2 3 4 5 6 7; do piece $k "${kind#*:}" "${kind%:*}" "p$k.ply"; done
  expect_document 0 encode --live p[0-7].ply -o rounded.l4d -f
  expect_json out "abs(d['end'] - 8 * ${kind#*:}) < 1.1 / ${kind%:*}"
  expect_equal "$(gaps rounded.l4d)" 0.0
  expect 0 validate rounded.l4d
done

# A piece that is lost is noted with its seconds, and what is there is coded.
for k in 0 1 2 3; do piece $k 1 30 "g$k.ply"; done
expect 0 encode --live g0.ply g1.ply g3.ply -o hole.l4d
expect_text err '^note: g3.ply begins at 3 s, and the pieces before it end at 2 s: no piece has the 1 s'
expect_document 0 encode --live g0.ply g1.ply g3.ply -o hole.l4d -f
expect_json out 'sum("no piece has the" in n for n in d["notes"]) == 1 and d["end"] == 4'
expect 0 validate hole.l4d
expect_document 0 encode --live g0.ply g1.ply g2.ply g3.ply -o whole.l4d
expect_json out 'not d.get("notes")'

# Lossless is what is drawn: what is fainter is left out, and counted.
"$PYTHON" - << 'PY'
import struct
data = open("g0.ply", "rb").read()
head, body = data.split(b"end_header\n", 1)
names = [line.split()[1:] for line in head.decode().splitlines() if line.startswith("property")]
at = sum({"float": 4, "double": 8}[kind] for kind, name in names[:[n for _, n in names].index("opacity")])
body = bytearray(body)
body[at:at + 4] = struct.pack("<f", -8)
open("faint.ply", "wb").write(head + b"end_header\n" + bytes(body))
PY
expect_document 0 encode --live faint.ply --preset lossless -o faint.l4d -f
expect_json out 'd["notes"] == ["faint.ply: 1 Gaussian of an opacity below 1/255 left out, which nothing draws"]'
expect_document 0 encode --live g0.ply --preset lossless -o faint.l4d -f
expect_json out 'not d.get("notes")'

# A piece without Gaussians is time in which what is known lives on; also the first one.
for k in 0 1 2; do piece $k 2 30 "q$k.ply" 50; done
"$PYTHON" - << 'PY'
import re
for k in (0, 1):
    head = open(f"q{k}.ply", "rb").read().split(b"end_header\n", 1)[0].decode()
    head = re.sub(r"element vertex \d+", "element vertex 0", head)
    open(f"empty{k}.ply", "wb").write(head.encode() + b"end_header\n")
PY
for preset in default lossless indexed; do
  expect_document 0 encode --live q0.ply empty1.ply q2.ply --preset $preset -o pause.l4d -f
  expect_json out 'd["num_media"] == 3 and d["end"] == 6'
  expect_document 0 validate pause.l4d
  expect_json out 'len({m["conformance"]["profile"] for m in d["conformance"]["members"]}) == 1'
  expect_document 0 encode --live empty0.ply q1.ply --preset $preset -o late.l4d -f
  expect_document 0 validate late.l4d
  expect_document 0 slice late.l4d --time 0.5 --digest
  expect_json out 'd["frames"][0]["gaussians"] == 0'
done
expect 4 encode empty0.ply -o empty.l4d
expect 4 encode --live empty0.ply -o empty.l4d
expect_missing empty.l4d

# What is no piece: the output, folders, links that lead nowhere.
rm -rf in
mkdir -p in/folder.ply
ln -s nowhere in/a.ply
cp q0.ply in/0.ply
touch in/end
expect_document 0 encode --live in -o in/out.l4d --playlist in/out.m3u8
expect_json out 'd["num_pieces"] == 1 and sum("is no file" in n for n in d["notes"]) == 2'
expect 0 validate in/out.l4d

# A piece that is there is never written over: not by its name, nor by another link to it.
cp in/out.l4d in/1.l4d
ln in/1.l4d linked.l4d
cp in/1.l4d before.l4d
expect 2 encode --live in -f -o in/1.l4d
expect 2 encode --live in -f -o linked.l4d
expect 2 encode --live in -f -o in/out.l4d
cmp in/1.l4d before.l4d
cmp linked.l4d before.l4d

# Numbers of pieces count, however many digits they have; one that comes too late is noted.
rm -rf in
mkdir in
for k in 8 9 10 11; do piece "$k" 1 30 "in/piece_$k.ply"; done
touch in/end
expect_document 0 encode --live in -o numbers.l4d
expect_json out 'd["num_pieces"] == 4 and d["end"] == 12'
rm in/end
l4d encode --live in -o behind.l4d --json > behind.json &
wait_for "the first member" test -e behind.l4d
cp in/piece_8.ply in/piece_7.ply
touch in/end  # it looks at the pieces once more when it finds this
wait $!
expect_json behind.json 'sum("piece_7.ply came after" in n for n in d["notes"]) == 1'

# A piece that is wrong ends the file as a whole one.
printf 'ply\nnonsense\n' > bad.ply
expect 4 encode --live q0.ply q1.ply bad.ply q2.ply -o broken.l4d --playlist broken.m3u8
expect_text err 'bad.ply: .*; broken.l4d ends at 4 s, with the [0-9]+ whole members'
expect 0 validate broken.l4d
expect_document 0 info broken.l4d
expect_json out 'd["members"][-1]["role"] == "index"'
expect_text broken.m3u8 ENDLIST

# Ctrl-C and SIGTERM end it as a whole file.
for signal in INT TERM; do
  rm -rf in
  mkdir in
  cp q0.ply in/0.ply
  "$L4DCODEC" encode --live in -f -o stopped.l4d --playlist stopped.m3u8 2> err &
  pid=$!
  wait_for "a segment" has_segments stopped.m3u8 1
  kill -$signal "$pid"
  status=0
  wait "$pid" || status=$?
  expect_equal "$status" 130
  expect_text err 'stopped.l4d ends at 2 s'
  expect_text stopped.m3u8 ENDLIST
  expect_document 0 validate stopped.l4d
  expect_document 0 info stopped.l4d
  expect_json out 'd["members"][-1]["role"] == "index"'
  rm stopped.m3u8
done

# A full disk leaves the members that are whole.
expect 0 encode --live q0.ply q1.ply q2.ply -o room.l4d
limit=$(json <(l4d info room.l4d --json) '(d["members"][1]["offset"] + d["members"][1]["bytes"]) // 1024 + 2')
status=0
(
  ulimit -f "$limit"
  l4d encode --live q0.ply q1.ply q2.ply -o full.l4d
) > out 2> err || status=$?
expect_equal "$status" 3
expect_text err 'full.l4d: cannot write: File too large; full.l4d ends at'
expect_document 0 validate full.l4d
expect_document 0 info full.l4d
expect_json out 'd["members_rest"] is None and len(d["members"]) >= 2'

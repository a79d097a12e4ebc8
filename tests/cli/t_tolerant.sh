# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# --tolerant: damage costs what it hits, and is told.
make_scene s.ply 5000
expect 0 encode s.ply -o s.l4d --preset lossless --set merge-count=0 --set merge-fraction=0 --set page-size=256
expect_document 0 decode s.l4d --tolerant -o whole.ply
expect_json out 'd["losses"] == [] and d["num_gaussians"] == 5000'
expect 0 decode s.l4d -o strict.ply
cmp whole.ply strict.ply

# damage FROM TO PLACES: a copy with one byte changed at each of these shares of its length.
damage() {
  "$PYTHON" -c 'import sys
data = bytearray(open(sys.argv[1], "rb").read())
for share in sys.argv[3].split(","):
    data[int(float(share) * len(data))] ^= 0x20
open(sys.argv[2], "wb").write(data)' "$@"
}

# Pages lie in the second half of so small a file.
damage s.l4d bad.l4d 0.6,0.8,0.95
expect 4 decode bad.l4d -o no.ply
expect_missing no.ply
expect_document 0 decode bad.l4d --tolerant -o some.ply
expect_json out 'len(d["losses"]) == 3'
expect_json out 'all(l["status"] == "L4D_ERR_CHECKSUM" and l["clause"] == "CHNK-2" and l["num_pages"] == 1 for l in d["losses"])'
expect_json out 'd["num_gaussians"] == 5000 - sum(l["num_gaussians"] for l in d["losses"])'
expect_json out 'len(d["notes"]) == 1'
left=$(json out 'd["num_gaussians"]')
expect_text some.ply "^element vertex $left\$"
expect 0 decode bad.l4d --tolerant -o again.ply
expect_text err '^note: bad.l4d: damaged or unreadable in 3 places'
cmp some.ply again.ply

# A sequence of instants: each place is listed once.
expect 4 slice bad.l4d --fps 10 -o n_%02d.ply
expect_document 0 slice bad.l4d --fps 10 -o f_%02d.ply --tolerant
expect_json out 'd["num_frames"] == 20 and len(d["losses"]) == 3'
expect_document 0 slice s.l4d --fps 10 -o g_%02d.ply --tolerant
expect_json out 'd["losses"] == []'

# The end of the file is gone.
head -c "$(($(wc -c < s.l4d) * 3 / 4))" s.l4d > cut.l4d
expect 4 decode cut.l4d -o no.ply
expect_document 0 decode cut.l4d --tolerant -o cut.ply
expect_json out '0 < d["num_gaussians"] < 5000'
expect_json out 'all(l["status"] == "L4D_ERR_TRUNCATED" for l in d["losses"])'

# Headers are needed by all; a PLY has nothing to tolerate.
damage s.l4d headless.l4d 0.0001
expect 4 decode headless.l4d --tolerant -o no.ply
expect_document 0 decode s.ply --tolerant -o from_ply.ply
expect_json out 'd["losses"] == []'

# Images show what slices have, and the losses are the same.
make_cameras cameras.json
expect 4 render bad.l4d --time 1 -o no.png
expect_missing no.png
expect_document 0 slice bad.l4d --time 1 --tolerant --digest
cp out sliced
expect_document 0 render bad.l4d --time 1 --cameras cameras.json --tolerant -o some.png
expect_json out 'd["losses"] and d["losses"] == json.load(open("sliced"))["losses"]'
expect_json out 'len(d["notes"]) == 1'
expect_json out '0 < d["visible"] <= json.load(open("sliced"))["frames"][0]["gaussians"]'
expect 0 repair bad.l4d -o left.l4d
expect 0 render left.l4d --time 1 --cameras cameras.json -o left.png
cmp some.png left.png || die "other Gaussians are drawn than those that are right"
expect_document 0 render s.l4d --time 1 --cameras cameras.json --tolerant -o same.png
expect_json out 'd["losses"] == [] and d["notes"] == []'
expect 0 render s.l4d --time 1 --cameras cameras.json -o whole.png
cmp same.png whole.png
# Over a sequence each place is listed once.
expect_document 0 render bad.l4d --fps 10 --cameras cameras.json --tolerant -o r_%02d.png
expect_json out 'd["frames"] == 20 and len(d["losses"]) == 3'

# What is damaged all over leaves nothing, which is no result: all pages lie in what is changed here.
"$PYTHON" - <<'PY'
data = bytearray(open("s.l4d", "rb").read())
for at in range(len(data) // 25, len(data), 64):
    data[at] ^= 0x20
open("ruin.l4d", "wb").write(data)
PY
expect 4 decode ruin.l4d --tolerant -o ruin.ply
expect_text err 'ruin.l4d: damaged or unreadable, all of it'
expect 4 decode ruin.l4d --tolerant --format raw -o ruin.safetensors
expect_missing ruin.ply ruin.safetensors

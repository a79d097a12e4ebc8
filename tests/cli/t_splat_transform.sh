# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# Files of other formats against the tool that people convert them with: it reads what is written, and what it writes is read.
tool=${L4D_SPLAT_TRANSFORM:-$ROOT/build/peers/node_modules/.bin/splat-transform}
[ -x "$tool" ] || tool=$(command -v splat-transform) ||
  skip "no splat-transform (npm install @playcanvas/splat-transform; L4D_SPLAT_TRANSFORM names it)"
transform() { "$tool" -q -w "$@" > log 2>&1 || die "splat-transform $*: $(cat log)"; }
close() {
  "$PYTHON" "$ROOT/tests/cli/splats_close.py" "$@" > errors || die "$*: $(cat errors)"
}

make_scene s.ply 400
expect 0 slice s.ply --time 1 -o moment.ply

# Compressed PLY: 11 bits of the range of 256 Gaussians that lie together, and a byte for each of colours, opacity and harmonics.
transform moment.ply m.compressed.ply
transform m.compressed.ply theirs.ply
expect_document 0 convert m.compressed.ply ours.ply
expect_json out 'd["source"] == "compressed_ply" and d["num_gaussians"] > 100'
close theirs.ply ours.ply position=1e-5 covariance=1e-4 color=1e-6 opacity=1e-6 sh=1e-6
close moment.ply ours.ply position=0.02 covariance=0.05 color=0.02 opacity=0.003 sh=10
expect 0 convert moment.ply w.compressed.ply
transform w.compressed.ply their_w.ply
expect 0 convert w.compressed.ply ours_w.ply
close their_w.ply ours_w.ply position=1e-5 covariance=1e-4 color=1e-6 opacity=1e-6 sh=1e-6
close moment.ply their_w.ply position=0.02 covariance=0.05 color=0.02 opacity=0.003 sh=0.05

# SPZ 4: a 16th of a logarithm for scales, 9 bits and a sign for rotations, 8 bits for the rest; that tool keeps 5 and 4
# bits of harmonics, and reads and writes axes as they are.
expect_document 0 convert moment.ply m.spz
expect_json out 'any("one instant" in n for n in d["notes"]) and any("axes" in n for n in d["notes"])'
transform m.spz theirs.ply
close moment.ply theirs.ply position=2e-5 covariance=0.1 color=0.014 opacity=0.002 sh=10
transform moment.ply t.spz
transform t.spz theirs.ply
expect 0 convert t.spz t.ply
close theirs.ply t.ply position=1e-6 covariance=1e-3 color=1e-5 opacity=1e-5 sh=1e-5

# SOG 2: 16 bits of positions, codebooks of 256 values for scales and colours, a palette of harmonics.
transform -g cpu -i 1 moment.ply m.sog
if ! l4d convert m.sog sog.ply > out 2> err && grep -q 'built without libwebp' err; then
  echo 'SOG is not tested: the tool was built without libwebp'
else
  transform m.sog from_sog.ply
  expect_document 0 convert m.sog sog.ply --force
  expect_json out 'd["source"] == "sog"'
  close from_sog.ply sog.ply position=1e-5 covariance=1e-3 color=1e-5 opacity=1e-5 sh=1e-5
  close moment.ply sog.ply position=0.01 covariance=0.2 color=1 opacity=0.005 sh=10
  expect_document 0 convert moment.ply w.sog
  expect_json out 'any("one instant" in n for n in d["notes"])'
  transform w.sog their_w.ply
  expect 0 convert w.sog w.ply
  close their_w.ply w.ply position=1e-5 covariance=1e-3 color=1e-5 opacity=1e-5 sh=1e-5
  close moment.ply their_w.ply position=2e-3 covariance=0.1 color=0.02 opacity=0.002 sh=10
fi

# .splat, which that tool reads only.
"$PYTHON" - <<'PY'
import math, random, struct
random.seed(8)
with open("a.splat", "wb") as file:
    for _ in range(60):
        file.write(struct.pack("<6f", *(random.uniform(-9, 9) for _ in range(3)), *(random.uniform(0.01, 2) for _ in range(3))))
        file.write(bytes(random.randrange(1, 255) for _ in range(8)))
PY
transform a.splat their_splat.ply
expect 0 convert a.splat splat.ply
# Of a byte, that tool makes 2 b / 255 - 1, and others b / 128 - 1.
close their_splat.ply splat.ply position=1e-5 covariance=0.06 color=1e-6 opacity=1e-6 sh=1e-6

# KSPLAT, which that tool reads only: a full bucket of 40 Gaussians, and one of 20.
"$PYTHON" - <<'PY'
import random, struct
random.seed(7)
for level in range(3):
    header = bytearray(4096)
    header[1] = 1
    struct.pack_into("<IIIIH", header, 4, 1, 1, 60, 60, level)
    struct.pack_into("<ff", header, 36, -1.25, 1.5)
    section = bytearray(1024)
    struct.pack_into("<IIIIfHxxI", section, 0, 60, 60, 40, 2, 5.0, 12, 32767)
    struct.pack_into("<IIH", section, 32, 1, 1, 2)
    body = b"" if level == 0 else struct.pack("<I6f", 20, 1, 2, 3, -10, -20, -30)
    if level == 0:
        struct.pack_into("<IIIf", section, 8, 0, 0, 0, 0)
        struct.pack_into("<II", section, 32, 0, 0)
    for _ in range(60):
        if level == 0:
            body += struct.pack("<3f", *(random.uniform(-9, 9) for _ in range(3)))
        else:
            body += struct.pack("<3H", *(random.randrange(65536) for _ in range(3)))
        number = "f" if level == 0 else "e"
        body += struct.pack("<3" + number, *(random.uniform(0.001, 2) for _ in range(3)))
        body += struct.pack("<4" + number, *(random.uniform(-1, 1) for _ in range(4)))
        body += bytes(random.randrange(1, 255) for _ in range(4))
        if level == 2:
            body += bytes(random.randrange(256) for _ in range(24))
        else:
            body += struct.pack("<24" + number, *(random.uniform(-1, 1) for _ in range(24)))
    open(f"k{level}.ksplat", "wb").write(header + section + body)
PY
for level in 0 1 2; do
  transform k$level.ksplat their_k$level.ply
  expect_document 0 convert k$level.ksplat k$level.ply
  expect_json out 'd["source"] == "ksplat" and d["num_gaussians"] == 60'
  close their_k$level.ply k$level.ply position=1e-5 covariance=1e-4 color=1e-6 opacity=1e-6 sh=1e-6
done

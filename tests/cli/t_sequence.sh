# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# Frames, each a file with a static scene, become one stream that shows each at its time.
make_scene s.ply 400
mkdir frames
expect 0 slice s.ply --from 0 --to 1 --fps 30 -o frames/f_%03d.ply
expect 0 encode 'frames/f_%03d.ply' --fps 30 --preset lossless -o clip.l4d
expect_text err '30 frames with .* rows go on from a frame before'
expect_document 0 info clip.l4d
expect_json out 'd["num_frames"] == 30 and d["num_gaussians"] < 800'
# What the stream shows at the time of a frame is that frame, but for what is too faint to be drawn.
count_seen() {
  "$PYTHON" - "$1" <<'PY'
import math, struct, sys
data = open(sys.argv[1], "rb").read()
end = data.index(b"end_header\n")
names = [l.split()[-1] for l in data[:end].decode().splitlines() if l.startswith("property")]
body, width = data[end + 11:], 4 * len(names)
rows = [struct.unpack_from("<%df" % len(names), body, i) for i in range(0, len(body), width)]
at = names.index("opacity")
print(sum(1 / (1 + math.exp(-r[at])) >= 1.2 / 255 for r in rows))
PY
}
for k in 0 13 29; do
  t=$("$PYTHON" -c "print(repr($k / 30))")
  expect 0 slice clip.l4d --time "$t" -o s.ply.$k
  a=$(count_seen "frames/f_$(printf %03d $k).ply") b=$(count_seen s.ply.$k)
  "$PYTHON" -c "import sys; sys.exit(abs($a - $b) > 0.02 * $a + 2)" || die "frame $k: $a are $b Gaussians"
done

# The same by a folder, and by names; the rate may follow from a duration.
expect 0 encode frames --seconds 1 --preset lossless -o folder.l4d
cmp clip.l4d folder.l4d
expect 0 encode frames/*.ply --fps 30 --preset lossless -o names.l4d
cmp clip.l4d names.l4d
echo text > frames/notes.txt
expect 0 encode frames --fps 30 --preset lossless -o folder.l4d --force
expect_text err 'frames: 1 entry that is no scene is not read: notes.txt'
mkdir frames/folder.ply
touch frames/.hidden.ply
expect 0 encode frames --fps 30 --preset lossless -o folder.l4d --force
cmp clip.l4d folder.l4d
expect_text err 'frames: 3 entries that are no scenes are not read, as .hidden.ply'
rm -r frames/folder.ply frames/.hidden.ply
expect 0 encode frames -o rate.l4d --preset lossless
expect_text err 'no frame rate; 30'
expect 2 encode frames --fps 30 --seconds 1 -o both.l4d
expect_text err 'not both'
mkdir gaps
cp frames/f_003.ply gaps/f_3.ply
cp frames/f_004.ply gaps/f_4.ply
cp frames/f_010.ply gaps/f_10.ply
expect 0 encode gaps --fps 30 -o gaps.l4d
expect_text err 'gaps: the numbers of its files leave out 5, first behind gaps/f_4.ply'
cp frames/f_003.ply gaps/f_03.ply
cp frames/f_003.ply gaps/input.ply
expect 0 encode gaps --fps 30 -o gaps.l4d --force
expect_text err 'gaps/f_0?3.ply and gaps/f_0?3.ply have the same number'
expect_text err 'names of 2 kinds, as gaps/f_.*ply and gaps/input.ply; all are taken as frames'
expect 0 encode frames --fps 30 --match none --preset lossless -o none.l4d
"$PYTHON" -c 'import os, sys; sys.exit(os.path.getsize("none.l4d") < 5 * os.path.getsize("clip.l4d"))' ||
  die 'matches save nothing'
expect 0 encode frames --fps 30 --sequence-error position=0.5,color=0.05 -o coarse.l4d

# Names are ordered by their numbers as people read them.
takes_in_order() {  # NAMES: of the first frames
  local k=0 name
  rm -rf ordered
  mkdir ordered
  for name in "$@"; do
    cp "frames/f_$(printf %03d $k).ply" "ordered/$name.ply"
    k=$((k + 1))
  done
  expect 0 convert ordered 'ordered_%d.ply' -f
  for ((k = 0; k < $#; ++k)); do
    cmp "ordered_$k.ply" "converted_$k.ply" || die "$*: frame $k"
  done
}
for k in 0 1 2 3; do expect 0 convert "frames/f_00$k.ply" "converted_$k.ply"; done
takes_in_order f_1 f_2 f_10
takes_in_order t_0.0 t_0.25 t_0.5
if grep -q 'note.*ordered' err; then die 'fractions leave nothing out'; fi
takes_in_order t_0 t_0.5 t_1 t_1.5
if grep -q 'note.*ordered' err; then die 'fractions are of one kind'; fi
takes_in_order t_0.10 t_0.25 t_0.50 t_0.55
expect_text err 'ordered: the numbers of its files are not evenly spaced, first behind ordered/t_0.10.ply'
takes_in_order v2.8 v2.9 v2.10 v2.11
takes_in_order 1.2.9 1.2.10 1.2.11
takes_in_order f-2 f-1 f0
if grep -q 'note.*ordered' err; then die 'signs are of one kind'; fi
takes_in_order f-1 f-2 f-10
takes_in_order f_-10 f_-2
takes_in_order f-1.5 f-0.25 f0 f0.5

# Lists keep their order; that of a shell is told.
takes_in_order f_1 f_2 f_10
expect 0 encode ordered/*.ply --fps 30 -o list.l4d
expect_text err "ordered/f_10.ply before ordered/f_2.ply; .*'ordered/f_\*.ply' in quotes"
expect 0 encode ordered/f_1.ply ordered/f_2.ply ordered/f_10.ply --fps 30 -o list.l4d -f
if grep -q 'in quotes' err; then die 'the list has an order'; fi

# What has the name of a frame and is none is an error that names it, however it is found.
refuses_frame() {  # NAME STATUS PATTERN
  expect "$2" encode frames -o x.l4d
  expect_text err "frames/$1: .*$3"
  expect "$2" encode frames/f_000.ply "frames/$1" -o x.l4d
  expect_text err "frames/$1: .*$3"
  rm "frames/$1"
}
: > frames/f_030.ply
refuses_frame f_030.ply 4 'the file is empty'
printf 'ab' > frames/f_030.ply
refuses_frame f_030.ply 4 'not a PLY file'
head -c 100 /dev/zero > frames/f_030.ply
refuses_frame f_030.ply 4 'not a PLY file'
head -c 100 /dev/zero > frames/f_030.glb
refuses_frame f_030.glb 5 'not a glTF file, although its name says so'
ln -s absent frames/f_030.PLY
refuses_frame f_030.PLY 3 'cannot open'
mkfifo frames/f_030.ply
refuses_frame f_030.ply 3 'is no regular file'
cp clip.l4d frames/f_030.ply
refuses_frame f_030.ply 5 'this is a stream, .*concat. joins streams'
head -c 300 frames/f_003.ply > frames/f_030.ply
refuses_frame f_030.ply 4 'the file ends in its header, in line'
mkdir streams
cp clip.l4d streams
expect 3 encode streams -o x.l4d
expect_text err 'streams: no file of a scene is there, but streams, as streams/clip.l4d; .l4dcodec concat. joins'
expect 5 encode clip.l4d none.l4d -o x.l4d
expect_text err 'clip.l4d: this is a stream, .*concat. joins'

# Patterns reach into folders; what nothing matches says so, and what would.
mkdir -p n/1 n/2 n/10
for k in 1 2 10; do cp "frames/f_$(printf %03d $k).ply" "n/$k/point_cloud.ply"; done
for pattern in 'n/*/point_cloud.ply' 'n/*/*.ply'; do
  expect 0 convert "$pattern" 'n_%d.ply' -f
  cmp n_0.ply converted_1.ply
  cmp n_1.ply converted_2.ply
done
expect 2 encode 'n/%d/point_cloud.ply' -o x.l4d
expect_text err "'n/3/point_cloud.ply' is missing"
expect 2 encode 'n/%d/f_%d.ply' -o x.l4d
expect_text err 'has one %d; a pattern with several'
mv n/10 n/3
expect 0 encode 'n/%d/point_cloud.ply' --fps 30 -o x.l4d
rm x.l4d
expect 3 encode n -o x.l4d
expect_text err "n: no file of a scene is there, but folders with some; 'n/\*/point_cloud.ply' names one of each"
expect 3 encode 'n/*.ply' -o x.l4d
expect_text err 'n/\*.ply: no file has a name of this pattern'
expect 3 encode 'frames/f_%d.ply' -o x.l4d
expect_text err 'no file has a name of this pattern; frames/f_000.ply is one of %03d'
expect 3 encode 'ordered/f_%04d.ply' -o x.l4d
expect_text err 'no file has a name of this pattern; ordered/f_1.ply is one of %d'
for verb in info 'render --time 0 -o x.png' 'slice --time 0 -o x.ply' 'compare clip.l4d'; do
  # shellcheck disable=SC2086  # options
  expect 3 $verb frames
  expect_text err 'frames: is a folder; .encode. and .convert. make a stream'
done
for pattern in 'frames/f_%03d.ply' 'frames/*.ply'; do
  expect 3 info "$pattern"
  expect_text err 'ply: cannot open: .*; .encode. and .convert. make a stream of the frames'
done
: > empty.ply
for input in - empty.ply; do
  for verb in info 'slice --time 0 -o x.ply' 'encode -o x.l4d'; do
    # shellcheck disable=SC2086  # options
    expect 4 $verb $input < empty.ply
    expect_text err '(stdin|empty.ply): the file is empty'
  done
done
expect 2 convert 'frames/f_%03d.ply' x.spz
expect_text err "'x.spz' shows one instant of a sequence: --time says which"
expect 0 convert frames/f_000.ply other.spz
expect 4 encode frames/f_000.ply other.spz -o x.l4d
expect_text err 'other.spz: it differs from the frames before in coordinate system: .*these state nothing'
expect 0 encode frames --match order --fps 30 -o order.l4d
expect_text err 'frames have different numbers of rows, first in frames/f_'
expect 0 encode 'ordered/f_1.*' --fps 1 -o one.l4d
expect_text err 'note: 1 frame with '
expect 0 info one.l4d
expect_text out ' 1 frame at 1 fps'
expect 0 encode frames --fps 30000/1001 -o rate.l4d -f
expect_document 0 info rate.l4d
expect_json out 'd["fps_rational"] == [30000, 1001]'
for rate in 30/0 30/ 1/2/3 -30/1; do
  expect 2 encode frames --fps "$rate" -o x.l4d
  expect_text err 'fps'
done

# Careless hands.
expect 2 encode frames
expect_text err '.--output is needed|--output is needed'
expect 2 encode s.ply --match order -o x.l4d
expect 2 encode frames --match rows -o x.l4d
expect 2 encode frames --sequence-error size=1 -o x.l4d
expect_text err 'none of position'
expect 2 encode frames --sequence-error position=-1 -o x.l4d
expect 3 encode 'frames/g_%d.ply' -o x.l4d
expect_text err 'no file has a name of this pattern'
rm frames/f_007.ply
expect 2 encode 'frames/f_%03d.ply' -o x.l4d
expect_text err 'f_007.ply. is missing'
mkdir empty
expect 3 encode empty -o x.l4d
expect 5 encode s.ply s.ply -o x.l4d
expect_text err 's.ply: a scene that changes over time'
cp frames/f_001.ply damaged.ply
truncate -s -1 damaged.ply
expect 4 encode frames/f_000.ply damaged.ply -o x.l4d
expect_text err 'damaged.ply'
expect 6 encode frames --limit-memory 20k -o x.l4d
expect_missing x.l4d

# Frames that become frames are converted one by one, and keep what a 4D scene would round.
expect 0 convert frames 'again_%02d.ply'
frame=0
for file in frames/f_*.ply; do
  expect 0 convert "$file" alone.ply -f
  cmp alone.ply "$(printf 'again_%02d.ply' "$frame")"
  frame=$((frame + 1))
done
expect_missing "$(printf 'again_%02d.ply' "$frame")"
expect 2 convert frames 'frames/f_%03d.ply' -f

# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# Slips of careless users: each is refused before any work, in words that name what is wrong, and leaves
# everything as it was.
make_scene s.ply 300
make_cameras c.json
expect 0 encode s.ply -o s.l4d --preset lossless
expect 0 sensitivity s.ply --cameras c.json --frames 0 -o w.ply
expect 0 slice s.ply --time 1 -o frame.ply
mkdir frames
: > after
ls > before

# refused WORDS ARGUMENTS...: status 2, and words (an extended regular expression) on stderr.
refused() {
  expect 2 "${@:2}"
  expect_empty out
  expect_text err "$1"
}
# All values of one option: refuses OPTION WORDS VALUE... -- COMMAND...
refuses() {
  local option=$1 words=$2 values=()
  shift 2
  while [ "$1" != -- ]; do
    values+=("$1")
    shift
  done
  shift
  local value
  for value in "${values[@]}"; do refused "$words" "$@" "$option=$value"; done
}

# Numbers.
whole='is not a whole number'
refuses --seed "--seed: .* $whole" -1 1.5 1e3 0x10 abc ' 7' 18446744073709551616 -- synth -n 10 -o x.ply
refuses --seed "$whole" -1 -- encode s.ply -o x.l4d
refuses --seed "$whole" -1 -- sensitivity s.ply --orbit 2 -o x.ply
refuses --threads "$whole from 0 to 4096" -1 4097 abc 0x2 1.0 -- info s.l4d
refuses --max-level "$whole from 0 to 63" -1 64 3.0 -- decode s.l4d -o x.ply
refuses --max-errors "$whole" -1 ten -- validate s.l4d
refuses --crf "$whole from 0 to 51" -1 52 -- render s.l4d -o x.mp4
refuses --orbit "$whole from 1 to 100000" 0 -1 1e3 -- sensitivity s.ply -o x.ply
refuses --gaussians 'count or size' -5 nan inf 1e400 ten -- synth -o x.ply
refuses --gaussians 'gaussians' 0 1.5 -- synth -o x.ply
refuses --gaussians 'Gaussians must be 1 to' 1T 9e18 -- synth -o x.ply
refuses --quality 'quality' nan inf 1e400 -5 19 91 40dBx 40db -- encode s.ply -o x.l4d
refuses --effort 'effort' 0 10 -1 7.5 nan -- encode s.ply -o x.l4d
refuses --prune-weight 'prune-weight' nan x -- encode s.ply -o x.l4d --weights w.ply
refuses --min-fidelity 'min-fidelity' nan 30km dB -- compare s.ply s.l4d --orbit 1
refuses --max-error 'max-error' position=-1 position=nan position= =1 position=1=2 beauty=1 -- compare s.ply s.l4d
refuses --error-gain 'error-gain' 0 -1 nan -- compare s.ply s.l4d --orbit 1 --side-by-side x.png
refuses --scale 'scale' 0 -1 nan 2x -- render s.l4d -o x.png
refuses --background 'background' 2,0,0 -1,0,0 1,2 0,0,0,0 nan,0,0 a,b,c ,, -- render s.l4d -o x.png
refuses --size '^l4dcodec: --size' 0x0 16385x1 1x16385 64 64x x64 64X64 64x64x64 -1x5 -- render s.l4d -o x.png
refuses --camera 'camera' 1.5 99 -1 abc 0-3 -- render s.l4d --cameras c.json -o x.png

# Units, and --limit-memory in commands that read no stream too.
for command in 'info s.l4d' 'synth -n 10 -o x.ply' 'encode s.ply -o x.l4d' 'version'; do
  # shellcheck disable=SC2086
  refuses --limit-memory 'limit-memory' 1ZB 0 -1 nan 1e30 1GiBB 1.5 ' 1G' -- $command
done
refuses --target-size 'target' 1ZB -1 0 nan -- encode s.ply -o x.l4d
refuses --target-bitrate 'target' 1ZB/s 1Mbyte/s -1 -- encode s.ply -o x.l4d

# Times.
refuses --time 'is not a time' nan inf 1e400 1:60 1:-5 :: 1: :1 0x10 1m -- decode s.l4d -o x.ply
refuses --time 'is not a time' nan -- info s.l4d
refused 'to lies before' decode s.l4d -o x.ply --from 5 --to 1
refused 'to lies before' decode s.l4d -o x.ply --from 1 --to 0.5
refused 'to lies before' slice s.l4d -o x_%d.ply --from 9 --to 8
refused 'to must lie after' slice s.l4d -o x_%d.ply --from 1 --to 1
refused 'leave nothing of the sequence' slice s.l4d -o x_%d.ply --from 8 --to 9
refused 'to lies before' render s.l4d -o x_%d.png --range 1:0
for command in 'slice s.l4d -o x_%d.ply' 'render s.l4d -o x_%d.png' 'render s.l4d -o x.mp4' 'convert s.ply x_%d.spz'; do
  # shellcheck disable=SC2086
  refuses --fps 'fps' 0 -1 nan x -- $command
  # shellcheck disable=SC2086
  refuses --fps '^l4dcodec: --fps is 1e7; it must be above 0 and at most 1000000$' 1e7 -- $command
done
refused '^l4dcodec: 20000000 frames; a sequence has at most 16777216: ' slice frame.ply --seconds 20 --fps 1e6 -o x_%d.ply
for command in 'info s.l4d' 'decode s.l4d -o x.ply' 'render s.l4d -o x.png' 'compare s.l4d s.ply' \
  'encode s.l4d -o x.l4d' 'slice s.l4d --time 1 -o x.ply' 'sensitivity s.l4d --orbit 1 -o x.ply'; do
  # shellcheck disable=SC2086
  refuses --seconds 'seconds' 0 -1 nan -- $command
done
refuses --seconds 'seconds' 0 -1 nan 1e9 -- synth -n 10 -o x.ply

# What is empty: a variable of a script that is not set.
for option in --weights --cameras --order --save-weights --preset --target-size --metadata --set; do
  refused "$option" encode s.ply -o x.l4d $option ''
done
refused 'output: the value is empty' encode s.ply -o ''
refused 'output: the value is empty' render s.ply -o ''
refused 'input: the value is empty' info ''
refused 'an argument is empty' info s.ply ''
refused 'an argument is empty' ''
refused 'plot: the value is empty' info s.ply --plot ''
refused 'side-by-side: the value is empty' compare s.ply s.l4d --orbit 1 --side-by-side ''

# Twice, and at odds with each other.
refused 'preset: given 2 times, takes one value' encode s.ply -o x.l4d --preset tiny --preset small
refused 'output: given 2 times' encode s.ply -o x.l4d -o y.l4d
refused "'k' is given twice" encode s.ply -o x.l4d --metadata k=v --metadata k=w
refused 'UTF-8' encode s.ply -o x.l4d --metadata $'k=\xff'
refused 'UTF-8' encode s.ply -o x.l4d --metadata $'k=\xed\xa0\x80'
refused 'quality excludes a target' encode s.ply -o x.l4d --quality 40 --target-size 1MB
refused 'quality excludes a target' encode s.ply -o x.l4d --set quality=40 --target-size 1MB
refused 'error-gain needs --side-by-side' compare s.ply s.l4d --orbit 1 --error-gain 2
refused 'any-path' compare s.ply s.l4d --any-path
refused 'is one instant' slice s.l4d --time 1 -o x_%d.ply
refused 'is one instant' render s.l4d --time 1 -o x_%04d.png
for ending in ply 4dgs safetensors; do
  refused "'x_%04d.$ending' names a sequence, and this is one file; .slice. and .convert. write a file for each frame" \
    decode s.l4d --format "$([ $ending = safetensors ] && echo raw || echo l4d)" -o x_%04d.$ending
done
refused "names a sequence, and this is one file" encode s.ply -o x_%d.l4d
refused "names a sequence, and this is one file" synth -n 10 -o x_%d.ply
refused "names a sequence, and this is one file" cut s.l4d --to 1 -o x_%d.l4d
refused 'slice needs --time T, or an output name with one %d in it' slice s.l4d -o x.ply

# Folders that are not there, by their names.
for command in 'convert s.ply nodir/y_%d.spz' 'convert s.ply nodir/y_0.spz --time 1' 'slice s.l4d -o nodir/y_%d.ply' \
  'decode s.l4d -o nodir/y_0.ply' 'render s.l4d -o nodir/y_%d.png' 'encode s.ply -o nodir/y_0.l4d'; do
  # shellcheck disable=SC2086
  expect 3 $command
  expect_text err "^l4dcodec: nodir/y_0[.][a-z0-9]+: cannot create: there is no folder 'nodir'$"
done

# Names that promise something else.
for name in x.bmp x.jpg x.ply x.l4d x.PNG.gif; do
  refused "^l4dcodec: --output: '$name' ends in" render s.l4d --time 1 -o $name
done
refused 'ends in .ply, but what is written is .l4d' encode s.ply -o x.ply
refused 'ends in .l4d, but what is written is .ply' decode s.l4d -o x.l4d
refused 'ends in .png' slice s.l4d --time 1 -o x.png
refused 'ends in .l4d' sensitivity s.ply --orbit 1 -o x.l4d
refused 'ends in .l4d' synth -n 10 -o x.l4d
refused 'ends in .png' info s.l4d --plot x.png
refused 'ends in .jpg' compare s.ply s.l4d --orbit 1 --side-by-side x.jpg
refused 'ends in .json' encode s.ply -o x.l4d --cameras c.json --save-weights x.json

ls > after
cmp before after

# What is right stays right.
expect 0 render s.l4d --time 1 --size 16x16 -o X.PNG
expect 0 render s.l4d --time 1 --size 16x16 -o plain
expect 0 encode s.ply -o q.l4d --quality 42dB
expect 0 encode s.ply -o r.l4d --quality 42
cmp q.l4d r.l4d
expect 0 encode s.ply -o u.l4d --metadata $'k=\xc3\xa4\xe2\x82\xac\xf0\x9f\x8e\x88' --metadata l=
expect 0 synth --scene cloud -n 10 --seed 18446744073709551615 -o seed.ply
expect 0 synth --scene cloud -n 10 --seed 8 -o eight.ply
expect 0 synth --scene cloud -n 10 --seed 010 -o ten.ply
! cmp -s eight.ply ten.ply || die "010 is taken for eight"
expect 0 decode s.l4d -o t.ply --time=-1
expect_text err 'lies outside the sequence'
expect 0 slice s.l4d -o t.ply -f --time 1e300
expect_text err '--time 1e[+]300 lies outside'
expect 0 slice s.l4d -o t.ply -f --time 1700000000.125
expect_text err '--time 1700000000.125 lies outside'

# A scene of no Gaussian is no scene, for every command; nor is a file of nothing.
"$PYTHON" -c 'import re, sys
head = open("s.ply", "rb").read().split(b"end_header\n")[0] + b"end_header\n"
open("none.ply", "wb").write(re.sub(rb"element vertex \d+", b"element vertex 0", head))'
: > nothing.ply
for scene in none.ply nothing.ply; do
  expect_document 4 encode $scene -o x.l4d
  expect_document 4 decode $scene -o x.ply
  expect_document 4 info $scene
  expect_document 4 slice $scene --time 0 -o x.ply
  expect_document 4 render $scene -o x.png
  expect_document 4 compare $scene s.ply
  expect_document 4 compare s.ply $scene
  expect_document 4 sensitivity $scene --orbit 1 -o x.ply
done
expect 4 encode none.ply -o x.l4d
expect_text err '^l4dcodec: none.ply: the scene holds no Gaussian$'

# Odd names.
odd=$'t\xc3\xa4\xc3\x9f \xf0\x9f\x8e\x88 \'quoted" new\nline %d'
cp s.ply "$odd.ply"
expect_document 0 encode "$odd.ply" --preset lossless
cmp "$odd.l4d" s.l4d
expect_document 0 info "$odd.l4d" --plot "$odd.svg"
bytes=$'\xff\xfe'
cp s.ply "$bytes.ply"
expect_document 0 encode "$bytes.ply" --preset lossless
cmp "$bytes.l4d" s.l4d
cp s.ply ./-odd.ply
expect 2 encode -odd.ply
expect 0 encode --preset lossless -- -odd.ply
cmp ./-odd.l4d s.l4d
expect 0 encode ./-odd.ply --output=-other.l4d --preset lossless
cmp ./-other.l4d s.l4d
if command -v ffmpeg > /dev/null; then
  expect 0 render s.l4d --size 32x16 --range 0:0.1 --output="-v: $odd.mp4"
  [ -s "./-v: $odd.mp4" ] || die "no video"
fi
long=$(printf 'x%.0s' {1..251})
expect 0 encode s.ply -o "$long.l4d" --preset lossless
expect 3 encode s.ply -o "$long.more.l4d" --weights nothing-to-read.ply
expect 3 encode s.ply -o "$long.more.l4d"
expect_text err "^l4dcodec: $long.more.l4d: cannot write: File name too long"
expect 3 info "$(printf 'x%.0s' {1..5000})"
expect 3 encode s.ply -o s.ply/x.l4d
expect 3 encode s.ply -o .
expect 3 encode s.ply -o folder-that-is-not-there/
expect 3 info s.ply/x

# A disk that is full.
if [ -c /dev/full ]; then
  expect 3 synth --scene cloud -n 10 -o /dev/full
  expect 3 render s.l4d --size 16x16 -o /dev/full
  expect 3 info s.l4d --plot /dev/full
  expect 3 encode s.ply -o x.l4d --order /dev/full
  rm -f x.l4d
fi
status=0
(
  ulimit -f 20
  l4d synth --scene cloud -n 10k -o limited.ply > out 2> err
) || status=$?
expect_equal "$status" 3
expect_text err 'limited.ply: cannot write: File too large'
expect_missing limited.ply limited.ply.l4dtmp0
status=0
(
  ulimit -f 4
  l4d encode s.ply -o limited.l4d > out 2> err
) || status=$?
expect_equal "$status" 3
expect_text err "^l4dcodec: cannot write 'limited.l4d': File too large"

# Another user, who may read here and write nowhere.
if [ "$(id -u)" = 0 ] && command -v setpriv > /dev/null; then
  chmod 755 .
  cp "$L4DCODEC" tool
  chmod 755 tool
  other() {
    local want=$1 status=0
    shift
    setpriv --reuid=65534 --regid=65534 --clear-groups ./tool "$@" > out 2> err || status=$?
    expect_equal "$* $status" "$* $want"
  }
  if setpriv --reuid=65534 --regid=65534 --clear-groups ./tool version > out 2> err; then
    other 3 encode s.ply -o x.l4d
    expect_text err '^l4dcodec: x.l4d: cannot write: Permission denied'
    other 3 encode s.ply -o s.l4d -f
    chmod 777 .
    other 3 encode s.ply -o q.l4d -f
    expect_text err '^l4dcodec: q.l4d: cannot write: Permission denied'
    cmp q.l4d r.l4d
    cp s.ply secret.ply
    chmod 600 secret.ply
    other 3 info secret.ply
    expect_text err '^l4dcodec: secret.ply: cannot open: Permission denied'
    other 3 encode s.ply -o x.l4d --weights secret.ply
    expect_text err '^l4dcodec: secret.ply: cannot open: Permission denied'
    expect_missing x.l4d
    other 0 encode s.ply -o x.l4d --preset lossless
    cmp x.l4d s.l4d
  fi
fi

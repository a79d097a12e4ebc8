# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# Files of other programs are named, with what to do, whatever the command; no clause of the format
# is cited before it is known that a file has that format.
make_scene s.ply 200
l4d encode s.ply -o s.l4d --preset lossless -q

# named FILE WORDS: FILE is refused as WORDS by all that read scenes, with exit status 5.
named() {
  local command
  for command in "encode $1 -o x.l4d" "info $1" "slice $1 --time 0 -o x.ply" "decode $1 -o x.ply" \
    "compare $1 s.ply" "compare s.ply $1" "validate $1"; do
    # shellcheck disable=SC2086
    expect 5 $command
    expect_text err "$1: this is $2"
    if grep -q 'spec ' err; then die "$command cites a clause: $(cat err)"; fi
  done
}

zip() { # zip FILE NAME: a ZIP archive of one file
  "$PYTHON" -c 'import sys, zipfile; zipfile.ZipFile(sys.argv[1], "w").writestr(sys.argv[2], b"x" * 99)' "$@"
}
printf 'xgrids' > a.lcc
named a.lcc 'an LCC file, .*splat-transform IN out.ply'
gzip -c s.ply > a.ply.gz
named a.ply.gz 'a gzip file, .*unpack it first'
# Formats that are read, but not these bytes.
cp a.ply.gz a.spz
expect 4 encode a.spz -o x.l4d
expect_text err 'a.spz: no SPZ file'
printf 'NGSP%060d' 0 > unnamed
expect 5 encode unnamed -o x.l4d
expect_text err 'unnamed: version .* of SPZ'
head -c 5000 /dev/zero > a.ksplat
expect 5 encode a.ksplat -o x.l4d
expect_text err 'a.ksplat: version 0.0 of KSPLAT'
head -c 63 /dev/zero > A.SPLAT
expect 4 encode A.SPLAT -o x.l4d
expect_text err 'A.SPLAT: 63 bytes are no multiple of 32'
printf '\x894DGS9\r\n' > a.4dgs
expect 5 encode a.4dgs -o x.l4d
expect_text err 'a.4dgs: version 9 of .4dgs'
cp a.ksplat b.4dgs
expect 4 info b.4dgs
expect_text err 'b.4dgs: no .4dgs file'
zip a.sog meta.json
expect 4 encode a.sog -o x.l4d
expect_text err 'a.sog: meta.json'
zip b.sog image.webp
expect 4 info b.sog
expect_text err 'b.sog: the ZIP archive has no file meta.json'
zip a.npz position.npy
named a.npz 'an archive of NumPy arrays, .*export a PLY'
zip a.pt archive/data.pkl
named a.pt 'a PyTorch checkpoint, '
zip other notes.txt
named other 'a ZIP archive, '
echo '{"asset": {"version": "2.0"}}' > a.gltf
expect 5 info a.gltf
expect_text err 'a.gltf: there are no splats in it'
head -c 100 /dev/zero > junk.glb
named junk.glb 'not a glTF file, although its name says so'
printf '\x93NUMPY%060d' 0 > a.l4d
named a.l4d 'a NumPy array, '
echo '{"frames": []}' > transforms.json
named transforms.json 'a JSON file, .*--cameras'
printf '\x89PNG\r\n\x1a\n%060d' 0 > a.png
named a.png 'an image, .*l4dtrain train'
printf '....ftypisom%060d' 0 > a.mp4
named a.mp4 'a video, .*l4dtrain train'
printf '<!DOCTYPE html><html>%060d' 0 > page
named page 'a web page, '
# Numbers without a name of their format: 40 Gaussians of SPLAT.
"$PYTHON" -c 'import struct
row = lambda i: struct.pack("<6f8B", i / 8, 0, 1, 0.1, 0.2, 0.1, 200, 100, 50, 255, 255, 128, 128, 128)
open("numbers.sog", "wb").write(b"".join(map(row, range(40))))'
named numbers.sog 'a SPLAT file by its numbers, .*a name that ends in .splat'
printf 'version https://git-lfs.github.com/spec/v1\n%060d' 0 > pointer.ply
named pointer.ply 'a pointer of Git LFS .*git lfs pull'
"$PYTHON" -c 'import struct; open("s.safetensors", "wb").write(struct.pack("<Q", 8) + b"{\"a\":{} }"[:8])'
l4d info - < a.png > out 2> err && die 'an image was taken from stdin'
expect_text err 'stdin: this is an image'

# What nothing is known of.
printf '%064d' 0 > zeros
for command in 'encode zeros -o x.l4d' 'info zeros' 'slice zeros --time 0 -o x.ply'; do
  # shellcheck disable=SC2086
  expect 4 $command
  expect_text err 'zeros: this is no stream .* and no PLY'
done
: > empty
expect 4 info empty
expect_text err 'empty: the file is empty'
# To validate is to cite.
expect 4 validate zeros
expect_text out 'FILE-1'

# Names of formats that are not written.
for name in x.splat x.ksplat x.splatv x.usdc x.npz x.safetensors x.L4D; do
  expect 2 slice s.l4d --time 0 -o $name
  expect_text err "'$name' ends in"
  expect 2 decode s.l4d -o $name
done
expect 2 slice s.l4d --time 0 -o x.4dgs
for name in x.spz x.sog x.glb x.usda x.compressed.ply; do
  expect 2 decode s.l4d -o $name
done
for name in x.npz x.ply x.pt x.npy; do
  expect 2 decode s.l4d --format raw -o $name
  expect_text err "'$name' ends in .*, but what is written is .safetensors"
done
expect 2 encode s.ply -o x.spz
expect 2 synth -n 10 -o x.compressed.ply
[[ ! -e x.spz && ! -e x.npz ]]

# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# Wrong usage: two lines on stderr, nothing on stdout, exit status 2. Help: stdout, 0.

misuse() {
  expect 2 "$@"
  expect_empty out
  expect_equal "$(wc -l < err)" 2
  expect_text err '^see l4dcodec .*--help$'
}

misuse
misuse frobnicate
misuse encod scene.ply
expect_text err 'did you mean encode\?'
misuse encode
misuse encode a.ply --presett high
expect_text err 'unknown option --presett; did you mean --preset\?'
expect_text err '^see l4dcodec encode --help$'
# An option that is unknown is named before what lacks with it.
misuse encode --hlep
expect_text err 'unknown option --hlep; did you mean --help\?'
misuse compare a.ply --min-fidelty=40
expect_text err 'unknown option --min-fidelty; did you mean --min-fidelity\?'
misuse encode a.ply --threads x --presett high
expect_text err 'unknown option --presett; did you mean --preset\?'
misuse --limit-memory 1GiB decode a.l4d
expect_text err 'the option --limit-memory belongs behind the command decode$'
misuse encode a.ply b.ply
misuse encode a.ply --preset best
misuse decode a.l4d --time 1 --from 0
misuse info a.l4d -t many
misuse info a.l4d --backend gpu
misuse validate

make_scene s.ply 500
misuse encode s.ply -o s.l4d --codebook colour=4096
misuse encode s.ply -o s.l4d --codebook sh=0
misuse encode s.ply -o s.l4d --codebook sh
misuse encode s.ply -o s.l4d --codebook sh=12x
misuse encode s.ply -o s.l4d --stages all=1,0.5,0.6
misuse encode s.ply -o s.l4d --stages all=1,,0.5
misuse encode s.ply -o s.l4d --set nothing=1
misuse encode s.ply -o s.l4d --set page-size.sh=4096
misuse encode s.ply -o s.l4d --prune-weight 1e-8
misuse encode s.ply -o s.l4d --metadata =x
misuse encode s.ply -o s.l4d --quality 91
misuse encode s.ply -o s.l4d --quality 40dBx
misuse encode s.ply -o s.l4d --preset indexed --stages all=1 --quality 40
misuse encode s.ply -o s.l4d --preset indexed --stages all=1 --target-size 1MB
for preset in paper-small paper-large lossless; do
  misuse encode s.ply -o s.l4d --preset $preset --quality 40
  misuse encode s.ply -o s.l4d --preset $preset --target-size 1MB
done
expect_text err '^l4dcodec: a target: the preset .lossless. .* float32 bits'
misuse encode s.ply -o s.l4d --target-size 0
misuse encode s.ply -o s.l4d --target-size 3MBit
misuse encode s.ply -o s.l4d --target-bitrate 8Mbyte/s
misuse encode s.ply -o s.l4d --target-fidelity 40
misuse encode s.ply -o s.l4d --target-psnr-loss 0.2
misuse encode s.ply -o s.l4d --target-jod 9
misuse encode s.ply -o s.l4d --orbit 2 --target-jod 10
misuse encode s.ply -o s.l4d --orbit 2 --display standard_4k
misuse encode s.ply -o s.l4d --orbit 2 --target-jod 9 --display cinema
misuse encode s.ply -o s.l4d --orbit 2 --target-psnr-loss 0.2
misuse encode s.ply -o s.l4d --orbit 2 --target-fidelity 40km
misuse encode s.ply -o s.l4d --max-error beauty=1
misuse encode s.ply -o s.l4d --max-error position
misuse encode s.ply -o s.l4d --target-size 1MB --max-error position=1
expect_text err 'one target only'
misuse encode s.ply -o s.l4d --orbit 2 --weights w.ply --target-size 1MB
misuse info s.ply --plot
misuse slice s.ply -o o.ply
misuse slice s.ply --from 0 --to 1 -o o.ply
misuse slice s.ply --from 0 --to 1 -o o_%d_%d.ply
misuse slice s.ply --from 1 --to 0.5 -o o_%d.ply
misuse slice s.ply --time 1:75 -o o.ply
misuse decode s.ply --time nan -o o.ply
misuse render s.ply
misuse render s.ply --time 1 -o o.mp4
misuse render s.ply --range 0:1 -o o.png
misuse render s.ply --range 0:1:2 -o o_%d.png
misuse render s.ply --range 0:1 --time 1 -o o_%d.png
misuse render s.ply --orbit -o o.png
misuse render s.ply --size 640 -o o.png
misuse render s.ply --scale 0 -o o.png
misuse render s.ply --scale 1000 -o o.png
misuse render s.ply --background 1,2 -o o.png
misuse render s.ply --camera 9 -o o.png
misuse render s.ply --path slow -o o.png
misuse sensitivity s.ply -o o.ply
misuse sensitivity s.ply --orbit 0 -o o.ply
misuse sensitivity s.ply --orbit 2 --cameras c.json -o o.ply
misuse sensitivity s.ply --orbit 2 --frames 3:2 -o o.ply
misuse sensitivity s.ply --orbit 2 --agreement 2 -o o.ply
misuse sensitivity s.ply --orbit 2 --agreement 0.9 --all-views -o o.ply
misuse sensitivity s.ply --orbit 2 --size 10x -o o.ply
misuse encode s.ply -o s.l4d --frames 0:2
misuse encode s.ply -o s.l4d --save-weights o.ply
misuse encode s.ply -o s.l4d --all-views
misuse encode s.ply -o s.l4d --no-prune
misuse encode s.ply -o s.l4d --orbit 2 --weights w.ply
misuse encode s.ply -o s.l4d --orbit 2 --no-prune --prune-weight 0
misuse encode s.ply -o s.l4d --refit 4
misuse encode s.ply -o s.l4d --orbit 2 --refit 65
misuse encode s.ply -o s.l4d --orbit 2 --refit 4 --weights w.ply
misuse encode s.ply -o s.l4d --orbit 2 --refit 4 --no-prune
misuse encode s.ply -o s.l4d --orbit 2 --refit 4 --prune-weight 0
misuse encode s.ply -o s.l4d --orbit 2 --refit 4 --set prune-cost=0.1
misuse encode s.ply -o s.l4d --orbit 2 --refit 4 --metric sum
misuse encode s.ply -o s.l4d --orbit 2 --refit 4 --max-error log_scale=0.2
misuse encode s.ply s.ply -o s.l4d --orbit 2 --refit 4 --live
misuse compare s.ply s.ply --images
misuse compare s.ply s.ply --orbit 2 --images
misuse compare s.ply s.ply --min-fidelity 30
misuse compare s.ply s.ply --orbit 2 --error-gain -1
misuse synth -n 10 --effects static,rain -o o.ply
misuse synth -n 10 --seconds 0 -o o.ply
misuse compare - - < s.ply
misuse compare s.ply s.ply --max-error beauty=1
expect_missing s.l4d o.ply o_0.ply o.png o_0.png o.mp4

# A usage error is a document too where one was asked for.
for arguments in '' 'frobnicate' 'encode' 'encode a.ply --presett high' 'synth --seconds 0 -o x'; do
  # shellcheck disable=SC2086
  expect_document 2 $arguments
  expect_json out 'd["error"]["code"] == 2 and d["error"]["name"] == "USAGE"'
done

for verb in encode decode info slice render validate compare sensitivity synth version; do
  expect 0 "$verb" --help
  expect_empty err
  expect_text out "^Usage: l4dcodec $verb"
  # Every verb has the common options, and no line is wider than a terminal of 100 columns.
  for option in --json --quiet --force --threads --backend --progress; do
    expect_text out "$option"
  done
  if grep -E '.{101}' out; then die "help of $verb is too wide"; fi
  cp out by_option
  expect 0 help "$verb"
  cmp out by_option
done
# Help of what is read is one list, whatever the verb.
formats=
for verb in encode decode info slice render compare sensitivity convert cameras; do
  expect 0 "$verb" --help
  tr -s ' \n' ' ' < out > flat
  found=$(grep -o ' \.l4d, \.ply, [^)]*(docs/formats.md)' flat | sort -u)
  [ -n "$found" ] || die "help of $verb does not list what it reads"
  expect_equal "${formats:=$found}" "$found"
  [[ $verb != @(encode|render|compare|sensitivity|cameras) ]] ||
    expect_text flat 'cameras.json, transforms.*poses_bounds.npy,.*nerfstudio.*COLMAP'
done
# The add-on for Blender offers the same.
expect_equal "$(grep -o '\.[a-z0-9]*' <<< "${formats%(*}" | tr -d . | sort)" \
  "$(sed -n 's/^EXTENSIONS = //p' "$ROOT/python/blender/l4d_import/operators.py" | grep -o '[a-z0-9]*' | sort)"

# What a file has no use for is said by its name.
expect 0 encode s.ply -o u.l4d --preset lossless
expect 0 convert u.l4d u.spz --time 1
for command in 'info u.l4d' 'decode u.l4d -f -o u.ply' 'convert u.l4d u.ply -f' 'encode u.l4d -f -o v.l4d' \
  'compare u.l4d u.l4d'; do
  # shellcheck disable=SC2086
  expect 0 $command --seconds 7 --fps 12 --activated
  expect_text err 'u.l4d: --seconds 7 is not used: the file states a duration in seconds of 2'
  expect_text err 'u.l4d: --fps 12 is not used: the file states a frame rate of 30'
  expect_text err 'u.l4d: --activated is not used: .* this is l4d'
done
for command in 'slice u.l4d --time 1 -o w.ply' 'render u.l4d --time 1 --size 8x8 -o w.png' \
  'slice u.l4d --time 1 -f -o w.ply --tolerant'; do
  # shellcheck disable=SC2086
  expect 0 $command --seconds 7
  expect_text err 'u.l4d: --seconds 7 is not used'
done
expect 0 info u.spz --seconds 7 --fps 12 --activated
expect_text err 'u.spz: --activated is not used: .* this is spz'
expect_equal "$(grep -c 'not used' err)" 1
make_cameras made.json
misuse cameras --from made.json --seconds 7 -o again.json

expect 0 help
for verb in encode decode info slice render validate compare sensitivity synth version; do
  expect_text out "^  $verb "
done
expect 0 --version
expect_text out '^l4dcodec [0-9]+\.[0-9]+\.[0-9]+$'
expect_document 0 version
expect_json out 'd["bitstream"].count(".") == 1'

# Valid, but not supported where the build has no device code, and a matter of the machine where it has
# and there is no device.
if ! "$PYTHON" -c 'import json, sys; sys.exit("cuda" not in json.load(open("out"))["backends"])'; then
  expect_document 5 info s.ply --backend cuda
  expect_json out 'd["error"]["name"] == "L4D_ERR_FEATURE_UNSUPPORTED"'
elif "$PYTHON" -c 'import json, sys; sys.exit(len(json.load(open("out"))["devices"]) != 0)'; then
  expect_document 7 info s.ply --backend cuda
  expect_json out 'd["error"]["name"] == "L4D_ERR_DEVICE"'
else
  expect 0 encode s.ply -o s.l4d --force --backend cuda
  expect 0 info s.l4d --backend cuda
fi

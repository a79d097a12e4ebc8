#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: without_renderer.sh BUILD_DIR SOURCE_DIR [OPTION...]
# Builds the tool without the renderer in BUILD_DIR, with OPTION for CMake: it encodes, reads and compares; verbs and options
# that need images say that there is no renderer, with the exit status of what is unsupported, and
# write nothing.
set -euo pipefail

build=$1
jobs=${L4D_JOBS:-$(nproc)}
cmake -S "$2" -B "$build" -G Ninja -DCMAKE_BUILD_TYPE=Release -DL4D_BUILD_RENDER=OFF \
  -DL4D_BUILD_CLI=ON -DL4D_BUILD_TESTS=OFF -DL4D_BUILD_BENCH=OFF -DL4D_CUDA=OFF "${@:3}"
cmake --build "$build" -j "$jobs"
tool=$build/bin/l4dcodec

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
fail() {
  echo "FAIL: $*" >&2
  exit 1
}

# refused ARGUMENT...: exit status 5, a message that says why, and no file.
refused() {
  local status=0
  "$tool" "$@" >out 2>err || status=$?
  [[ $status == 5 ]] || fail "$*: exit status $status, expected 5"
  grep -q 'this build of l4dcodec has no renderer, which .* needs' err || fail "$*: $(cat err)"
  for name in picture.png weights.ply other.l4d; do
    [[ ! -e $name ]] || fail "$*: wrote $name"
  done
}

"$tool" synth --scene cloud --gaussians 500 --seconds 1 -o scene.ply
"$tool" encode scene.ply -o scene.l4d --order order --verify
"$tool" encode scene.ply -o small.l4d --target-size 20kB
"$tool" info scene.l4d --time 0.5
"$tool" validate scene.l4d
"$tool" compare scene.ply scene.l4d --order order
"$tool" slice scene.l4d --time 0.5 -o slice.ply
"$tool" decode scene.l4d -o decoded.ply
refused render scene.l4d -o picture.png --orbit
refused sensitivity scene.ply -o weights.ply --orbit 4
refused encode scene.ply -o other.l4d --orbit 4
refused encode scene.ply -o other.l4d --target-fidelity 40dB --orbit 4
refused compare scene.ply scene.l4d --orbit 4
"$tool" render scene.l4d -o picture.png --json >answer.json || true
grep -q '"name": "L4D_ERR_FEATURE_UNSUPPORTED"' answer.json || fail "$(cat answer.json)"
"$tool" render --help | grep -q 'no renderer' || fail "help of render does not say so"
echo "the tool works without the renderer"

#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: run.sh prepare|core|browser|firefox|spark|three|babylon|playcanvas TOOL WORK_DIR [FILE...]
# prepare: builds l4d.wasm and the packages, and makes scenes in WORK_DIR. core: the decoder and its sessions in node,
# against TOOL. browser: the player in Chromium, all of it or the files with these names (images: images.test.js).
# firefox: the same in Firefox, on a display of its own, where Mesa draws.
# spark, three, babylon, playcanvas: the adapters to these engines in Chromium.
# All but the first prepare first, unless L4D_WEB_PREPARED is set, as it is where ctest has run that before.
# Exit status 77: something that they need is not installed.
set -euo pipefail
usage="usage: run.sh prepare|core|browser|firefox|spark|three|babylon|playcanvas TOOL WORK_DIR [FILE...]"
kind=${1:?"$usage"} tool=${2:?"$usage"} work=${3:?"$usage"}
shift 3
[[ $kind =~ ^(prepare|core|browser|firefox|spark|three|babylon|playcanvas)$ ]] || { echo "unknown kind $kind" >&2 && exit 2; }
[[ $# -eq 0 || $kind =~ ^(browser|firefox)$ ]] || { echo "$usage" >&2 && exit 2; }
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
cd "$root"
files=()
for name in "$@"; do
  files+=("web/test/$name.test.js")
  [[ -e ${files[-1]} ]] || { echo "no file ${files[-1]}" >&2 && exit 2; }
done
[[ $# -ne 0 ]] || files=(web/test/*.test.js)

skip() {
  echo "skipped: $* (./dev setup web)"
  exit 77
}
command -v node >/dev/null || skip "no node"
has_packages() {
  [[ -d web/node_modules/playwright-core && -e web/node_modules/typescript/bin/tsc && -x web/node_modules/.bin/esbuild ]]
}
if [[ $kind != prepare && $kind != core ]]; then
  if [[ $kind == firefox ]]; then
    command -v firefox-esr >/dev/null || skip "no firefox-esr"
    command -v xvfb-run >/dev/null || skip "no xvfb"
  else
    command -v chromium-headless-shell chromium >/dev/null || skip "no chromium"
  fi
  has_packages || skip "no packages of npm in web/node_modules"
  case $kind in
    browser | firefox) engine=() ;;
    spark) engine=(@sparkjsdev/spark) ;;
    three) engine=(three iwer) ;;
    babylon) engine=(@babylonjs/core) ;;
    playcanvas) engine=(playcanvas) ;;
  esac
  for package in "${engine[@]}"; do
    [[ -d web/node_modules/$package ]] || skip "no $package in web/node_modules"
  done
fi

mkdir -p "$work"
is_new() { [[ $1 -nt $tool && $1 -nt web/test/run.sh ]]; } # or it may be another scene
# scene NAME SECONDS GAUSSIANS EFFECTS ENCODE_OPTION...
scene() {
  local name=$1 effects=()
  is_new "$work/$name.l4d" && return
  [[ $4 == all ]] || effects=(--effects "$4")
  "$tool" synth --scene cloud --seconds "$2" --fps 30 --gaussians "$3" --seed 5 "${effects[@]}" -q -f -o "$work/$name.ply"
  shift 4
  "$tool" encode "$work/$name.ply" --no-first-view "$@" -q -f -o "$work/$name.part.l4d"
  mv "$work/$name.part.l4d" "$work/$name.l4d"
}
prepare() {
  local what=() status=0
  rm -f "$work"/prepared "$work"/unprepared
  has_packages || what=(wasm) # which the decoder does without
  web/build.sh "${what[@]}" | tee "$work/build.log" || status=$?
  [[ $status != 77 ]] || tail -n 1 "$work/build.log" >"$work/unprepared"
  [[ $status == 0 ]] || exit "$status"
  scene long 20 20000 all
  scene short 4 2000 all
  scene indexed 4 2000 all --preset indexed
  scene lossless 4 2000 all --preset lossless
  scene frames 1 3000 frames
  # What fades in and out within a part of a second; of several layers, one with 128 buckets.
  scene brief 0.6 3000 flicker,appear
  scene layered 10 8000 flicker,appear --set merge-fraction=0 --set merge-count=0
  scene tiers 8 20000 all --tiers 0.15,0.5
  # Drawn and shown in ways of their own.
  scene dilated 1 2000 all --rendering dilation=16 --presentation playback=ping-pong,bounds=-2:-1:-3:2:1:3
  scene drawn 1 2000 all --rendering dilation=1.5,cutoff=1.7,min_alpha=0.05,max_alpha=0.7,compensation=1 \
    --presentation playback=loop,camera=0.5:-1:-6:0:0.25:0.5:0.1:-1:0:40,metres_per_unit=0.5
  # Of several streams, with playlists: as it is recorded, and as other files are joined.
  if ! is_new "$work/joined.m3u8"; then
    "$tool" synth --scene cloud --seconds 8 --fps 30 --gaussians 4000 --seed 6 -q -f -o "$work/members.ply"
    "$tool" encode "$work/members.ply" --no-first-view --live --segment 1 --playlist "$work/members.m3u8" -q -f -o "$work/members.l4d"
    "$tool" concat "$work/frames.l4d" "$work/short.l4d" "$work/tiers.l4d" -q -f -o "$work/joined.l4d"
    "$tool" manifest "$work/joined.l4d" -q -f -o "$work/joined.m3u8"
  fi
  touch "$work/prepared"
}

if [[ $kind == prepare || -z ${L4D_WEB_PREPARED:-} ]]; then
  prepare
elif [[ ! -e $work/prepared ]]; then
  [[ -e $work/unprepared ]] || { echo "nothing is prepared in $work" >&2 && exit 1; }
  cat "$work/unprepared" # why that was skipped
  exit 77
fi
[[ $kind != prepare ]] || exit 0
export L4D_TOOL=$tool L4D_WASM=$root/build/wasm/bin/l4d.wasm
export L4D_STREAMS=$work/long.l4d:$work/short.l4d:$work/indexed.l4d:$work/lossless.l4d:$work/frames.l4d
L4D_STREAMS+=:$work/tiers.l4d:$work/dilated.l4d:$work/drawn.l4d
export L4D_ROOT=$root L4D_WORK=$work
# A test of a browser may depend on which of two things comes first, and fail, or wait for ever, in one run of many. So
# files that fail run once more, and fail if they fail again. The summary of all tests names those that failed at first. It
# reads that from the first lines: of what a passing test prints, ctest keeps no more than 1024 bytes.
in_browser() {
  local log=$work/first.$kind.${files[0]##*/}.log
  # A file takes about a minute on two cores; at night Firefox gets all of them at once.
  local run=("$@" timeout --kill-after=30 $((300 + 100 * ${#files[@]})) node --test --test-concurrency=2 "${files[@]}")
  if "${run[@]}" >"$log"; then
    cat "$log"
  else
    grep '^not ok' "$log" | sed 's/^not ok [0-9]* - /failed at first: /' || echo "failed at first: ${files[*]}"
    cat "$log"
    "${run[@]}"
  fi
}
case $kind in
  # They wait more than they compute. The timeout, in ms, is also that of a file.
  core) node --test --test-timeout=900000 --test-concurrency=6 web/core/test/*.test.js web/view/test/*.test.js ;;
  # Without a display, Firefox has no WebGL.
  firefox) L4D_BROWSER=firefox in_browser xvfb-run --auto-servernum --server-args="-screen 0 1600x1200x24" ;;
  browser) in_browser ;;
  *)
    files=("web/$kind"/test/*.test.js)
    in_browser
    ;;
esac

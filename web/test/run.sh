#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: run.sh core|browser|spark TOOL WORK_DIR
# core: the decoder and its sessions in node, against TOOL. browser: the player in Chromium. spark: the adapter
# to Spark in Chromium.
# Exit status 77: something that they need is not installed.
set -euo pipefail
kind=${1:?"usage: run.sh core|browser|spark TOOL WORK_DIR"} tool=${2:?} work=${3:?}
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
cd "$root"

skip() {
  echo "skipped: $* (./dev setup web)"
  exit 77
}
command -v node >/dev/null || skip "no node"
if [[ $kind != core ]]; then
  command -v chromium >/dev/null || skip "no chromium"
  [[ -d web/node_modules/playwright-core ]] || skip "no packages of npm in web/node_modules"
  [[ $kind != spark || -d web/node_modules/@sparkjsdev/spark ]] || skip "no Spark in web/node_modules"
  web/build.sh
else
  web/build.sh wasm
fi

mkdir -p "$work"
# scene NAME SECONDS GAUSSIANS EFFECTS ENCODE_OPTION...
scene() {
  local name=$1 effects=()
  [[ $work/$name.l4d -nt $tool ]] && return
  [[ $4 == all ]] || effects=(--effects "$4")
  "$tool" synth --scene cloud --seconds "$2" --fps 30 --gaussians "$3" --seed 5 "${effects[@]}" -q -f -o "$work/$name.ply"
  shift 4
  "$tool" encode "$work/$name.ply" --no-first-view "$@" -q -f -o "$work/$name.part.l4d"
  mv "$work/$name.part.l4d" "$work/$name.l4d"
}
scene long 20 20000 all
scene short 4 6000 all
scene indexed 4 6000 all --preset indexed
scene lossless 4 6000 all --preset lossless
scene frames 1 3000 frames
# What fades in and out within a part of a second; of several layers, one with 128 buckets.
scene brief 0.6 3000 flicker,appear
scene layered 10 8000 flicker,appear --set merge-fraction=0 --set merge-count=0
scene tiers 8 20000 all --tiers 0.15,0.5
# Drawn and shown in ways of their own.
scene dilated 1 4000 all --rendering dilation=16 --presentation playback=ping-pong,bounds=-2:-1:-3:2:1:3
scene drawn 1 4000 all --rendering dilation=1.5,cutoff=1.7,min_alpha=0.05,max_alpha=0.7,compensation=1 \
  --presentation playback=loop,camera=0.5:-1:-6:0:0.25:0.5:0.1:-1:0:40,metres_per_unit=0.5
# Of several streams, with playlists: as it is recorded, and as other files are joined.
if [[ ! $work/joined.m3u8 -nt $tool ]]; then
  "$tool" synth --scene cloud --seconds 8 --fps 30 --gaussians 12000 --seed 6 -q -f -o "$work/members.ply"
  "$tool" encode "$work/members.ply" --no-first-view --live --segment 1 --playlist "$work/members.m3u8" -q -f -o "$work/members.l4d"
  "$tool" concat "$work/frames.l4d" "$work/short.l4d" "$work/tiers.l4d" -q -f -o "$work/joined.l4d"
  "$tool" manifest "$work/joined.l4d" -q -f -o "$work/joined.m3u8"
fi
export L4D_TOOL=$tool L4D_WASM=$root/build/wasm/bin/l4d.wasm
export L4D_STREAMS=$work/long.l4d:$work/short.l4d:$work/indexed.l4d:$work/lossless.l4d:$work/frames.l4d
L4D_STREAMS+=:$work/tiers.l4d:$work/dilated.l4d:$work/drawn.l4d
export L4D_ROOT=$root L4D_WORK=$work
case $kind in
  core) node --test --test-timeout=300000 web/core/test/*.test.js web/view/test/*.test.js ;;
  browser) node --test --test-timeout=900000 --test-concurrency=1 web/test/*.test.js ;;
  spark) node --test --test-timeout=900000 --test-concurrency=1 web/spark/test/*.test.js ;;
  *) echo "unknown kind $kind" >&2 && exit 2 ;;
esac

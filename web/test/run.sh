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
# scene NAME SECONDS GAUSSIANS PRESET
scene() {
  [[ $work/$1.l4d -nt $tool ]] && return
  "$tool" synth --seconds "$2" --fps 30 --gaussians "$3" --seed 5 -q -f -o "$work/$1.ply"
  "$tool" encode "$work/$1.ply" --preset "$4" -q -f -o "$work/$1.part.l4d"
  mv "$work/$1.part.l4d" "$work/$1.l4d"
}
scene long 20 20000 default
scene short 4 6000 default
scene indexed 4 6000 indexed
scene lossless 4 6000 lossless
export L4D_TOOL=$tool L4D_WASM=$root/build/wasm/bin/l4d.wasm
export L4D_STREAMS=$work/long.l4d:$work/short.l4d:$work/indexed.l4d:$work/lossless.l4d
export L4D_ROOT=$root L4D_WORK=$work
case $kind in
  core) node --test --test-timeout=300000 web/core/test/*.test.js web/view/test/*.test.js ;;
  browser) node --test --test-timeout=900000 --test-concurrency=1 web/test/*.test.js ;;
  spark) node --test --test-timeout=900000 --test-concurrency=1 web/spark/test/*.test.js ;;
  *) echo "unknown kind $kind" >&2 && exit 2 ;;
esac

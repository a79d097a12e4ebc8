#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: build.sh [wasm]
# Builds l4d.wasm (build/wasm) and the packages (build/web/l4dcodec, build/web/l4dcodec-player), and
# the player in few files (build/web/player), which the tool takes up when it is built after this.
# Where npm has installed engines: the adapters to them (build/web/l4dcodec-spark, -three, -babylon, -playcanvas) and
# their pages (build/web/spark, ..).
# `wasm`: no packages, which need what npm has installed. Exit status 77: something is not installed.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
cd "$root"
out=build/web

skip() {
  echo "skipped: $* (./dev setup web)"
  exit 77
}
for program in emcc node cmake ninja; do
  command -v "$program" >/dev/null || skip "no $program"
done
sources=${L4D_CROSS_SOURCES:-$root/build/cross-sources}
[[ -d $sources/highway ]] || skip "no sources of zstd, xxHash and Highway in $sources"

# quietly NAME COMMAND...: its output only where it fails.
quietly() {
  local log=$out/$1.log
  shift
  "$@" >"$log" 2>&1 || {
    cat "$log" >&2
    echo "FAIL: $*" >&2
    exit 1
  }
}

# Each compile starts Python, which may be a script that looks for it.
export EMSDK_PYTHON=${EMSDK_PYTHON:-$(python3 -c 'import sys; print(sys.executable)')}
mkdir -p "$out"
launcher=()
if command -v ccache >/dev/null; then
  launcher=(-DCMAKE_C_COMPILER_LAUNCHER=ccache -DCMAKE_CXX_COMPILER_LAUNCHER=ccache)
fi
unset CFLAGS CXXFLAGS LDFLAGS
quietly dependencies web/wasm/dependencies.sh "$root/build/wasm-prefix" "$root/build/wasm-dependencies"
quietly configure cmake --preset wasm "${launcher[@]}"
quietly wasm cmake --build --preset wasm -j "${L4D_JOBS:-$(nproc)}"
wasm=build/wasm/bin/l4d.wasm
echo "l4d.wasm: $(wc -c <"$wasm") bytes, $(gzip -9c "$wasm" | wc -c) with gzip -9"
[[ ${1:-} != wasm ]] || exit 0

bin=web/node_modules/.bin
[[ -e web/node_modules/typescript/bin/tsc && -x $bin/esbuild ]] || skip "no packages of npm in web/node_modules"
adapters=()
# adapter FOLDER PACKAGE...: of what npm has installed.
adapter() {
  local folder=$1 package
  shift
  for package in "$@"; do
    [[ -d web/node_modules/$package ]] || { echo "SKIPPED: l4dcodec-$folder: no $package in web/node_modules (./dev setup web)" && return; }
  done
  adapters+=("$folder")
}
adapter spark @sparkjsdev/spark three
adapter three three
adapter babylon @babylonjs/core
adapter playcanvas playcanvas
for package in core view "${adapters[@]}"; do
  name=$(sed -n 's/^  "name": "\(.*\)",$/\1/p' "web/$package/package.json")
  rm -rf "${out:?}/$name"
  mkdir -p "$out/$name"
  cp -r "web/$package/src" "web/$package/package.json" "$out/$name/"
  node web/node_modules/typescript/bin/tsc -p "web/$package"
  # Compilers from 5.4 on take them: types of WebGPU are not in their DOM, and arrays have no type of their buffer.
  find "$out/$name/types" -name '*.d.ts' -exec sed -Ei 's/\bGPU[A-Z]\w*/any/g; s/(Array)<ArrayBuffer(Like)?>/\1/g' {} +
  cp LICENSE "$out/$name/"
  cp "web/$package/README.md" "$out/$name/"
done
cp "$wasm" "$out/l4dcodec/src/"
cp web/view/player.d.ts web/view/react.d.ts "$out/l4dcodec-player/types/"

# The player in four files, and a page that shows scene.l4d.
player=$out/player.part
rm -rf "$player"
mkdir -p "$player"
bundle=("$bin/esbuild" --bundle --format=esm --minify --target=es2022 --log-level=warning --legal-comments=none
  "--alias:l4dcodec=./web/core/src/index.js" "--alias:l4dcodec-player/rules=./web/view/src/rules.js"
  "--alias:l4dcodec-player/splats=./web/view/src/splats.js")
"${bundle[@]}" web/view/src/index.js "--outfile=$player/player.js"
"${bundle[@]}" web/core/src/worker.js "--outfile=$player/worker.js"
"${bundle[@]}" web/view/src/sort-worker.js "--outfile=$player/sort-worker.js"
cp "$wasm" web/view/page/index.html "$player/"
# As it is where nothing has changed, or the tool would be linked anew.
if ! diff -rq "$player" "$out/player" >/dev/null 2>&1; then
  rm -rf "$out/player"
  mv "$player" "$out/player"
fi
rm -rf "$player"
player=$out/player
for file in player.js worker.js sort-worker.js; do
  echo "$file: $(wc -c <"$player/$file") bytes, $(gzip -9c "$player/$file" | wc -c) with gzip -9"
done

# All of it in one module, for pages of other origins and bundlers that leave files behind.
single=$out/l4dcodec-player/dist
mkdir -p "$single"
for file in worker sort-worker; do
  cp "$player/$file.js" "$single/$file.txt"
done
"${bundle[@]}" "--alias:inlined-worker=./$single/worker.txt" "--alias:inlined-sort-worker=./$single/sort-worker.txt" \
  "--alias:inlined-wasm=./$wasm" --loader:.txt=text --loader:.wasm=binary web/view/single.js "--outfile=$single/l4d-player.js"
rm "$single/worker.txt" "$single/sort-worker.txt"
echo "l4d-player.js: $(wc -c <"$single/l4d-player.js") bytes, $(gzip -9c "$single/l4d-player.js" | wc -c) with gzip -9"

# A page of each adapter, with its engine in it.
for adapter in "${adapters[@]}"; do
  page=$out/$adapter
  rm -rf "$page"
  mkdir -p "$page"
  "${bundle[@]}" "--alias:l4dcodec-$adapter=./web/$adapter/src/index.js" "web/$adapter/page/example.js" "--outfile=$page/example.js"
  cp web/spark/page/index.html "$player/worker.js" "$player/sort-worker.js" "$wasm" "$page/"
done

#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: run.sh aarch64|wasm|mingw WORK_DIR TOOL DIGEST
#        run.sh --bench wasm WORK_DIR TOOL DIGEST
# Builds the decoder and its tests for another architecture, runs them there (qemu-user, node, wine) and
# holds the digests of streams against those of DIGEST, the same program on this machine. Then the
# conformance suite asks the decoder there. --bench
# prints how long decoding takes there and here, on one thread.
# L4D_CROSS_SOURCES: where `./dev setup cross` has put the sources of zstd, xxHash and Highway.
set -euo pipefail

bench=''
if [[ ${1:-} == --bench ]]; then
  bench=1
  shift
fi
target=${1:?"usage: run.sh aarch64|wasm|mingw WORK_DIR TOOL DIGEST"}
work=$(realpath -m "${2:?}") tool=$(realpath "${3:?}") digest=$(realpath "${4:?}")
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
root=$(cd "$here/../.." && pwd)
sources=${L4D_CROSS_SOURCES:-$root/build/cross-sources}
jobs=${L4D_JOBS:-$(nproc)}

skip() {
  echo "skipped: $* (./dev setup cross)"
  exit 77
}

options=(-DCMAKE_TOOLCHAIN_FILE="$here/$target.cmake")
parts=(-DL4D_BUILD_ENCODER=OFF -DL4D_BUILD_RENDER=OFF)
case $target in
  aarch64)
    needs=(aarch64-linux-gnu-g++ qemu-aarch64)
    emulator=(qemu-aarch64 -L /usr/aarch64-linux-gnu)
    suffix=''
    ;;
  wasm)
    needs=(emcc node)
    # This version of Emscripten takes node's fetch for a browser's, which reads no files.
    emulator=(node --no-experimental-fetch)
    suffix=.js
    # Debian's own modules of node, where Emscripten's packages look for them.
    export NODE_PATH=${NODE_PATH:-/usr/share/nodejs}
    # Each compile starts Python, which may be a script that looks for it.
    export EMSDK_PYTHON=${EMSDK_PYTHON:-$(python3 -c 'import sys; print(sys.executable)')}
    ;;
  mingw)
    needs=(x86_64-w64-mingw32-g++-posix)
    emulator=(wine64)
    command -v wine64 >/dev/null || emulator=(/usr/lib/wine/wine64)
    needs+=("${emulator[0]}")
    suffix=.exe
    # Encoder and renderer too.
    parts=(-DL4D_BUILD_ENCODER=ON -DL4D_BUILD_RENDER=ON -DL4D_BUILD_CLI=OFF -DL4D_BUILD_BENCH=OFF
      -DEigen3_DIR="${L4D_EIGEN_DIR:-/usr/share/eigen3/cmake}")
    # A home of its own, and no words about what it lacks of a desktop.
    export WINEPREFIX=$work/mingw/wine WINEDEBUG=-all WINEDLLOVERRIDES="mscoree,mshtml=;winemenubuilder.exe=d"
    mkdir -p "$WINEPREFIX"
    ;;
  *) echo "unknown target $target" >&2 && exit 2 ;;
esac
for program in "${needs[@]}"; do
  command -v "$program" >/dev/null || skip "no $program"
done
for package in libzstd xxhash highway; do
  [[ -d $sources/$package ]] || skip "no sources of $package in $sources"
done

prefix=$work/$target/prefix
# A native compiler's settings are none of another architecture's.
unset CFLAGS CXXFLAGS LDFLAGS PKG_CONFIG_PATH
export PKG_CONFIG_LIBDIR=$prefix/lib/pkgconfig
if command -v ccache >/dev/null; then
  options+=(-DCMAKE_C_COMPILER_LAUNCHER=ccache -DCMAKE_CXX_COMPILER_LAUNCHER=ccache)
fi

# quietly LOG COMMAND...: its output only where it fails.
quietly() {
  local log=$1
  shift
  "$@" >"$log" 2>&1 || {
    cat "$log" >&2
    echo "FAIL: $*" >&2
    exit 1
  }
}

mkdir -p "$work/$target"
log=$work/$target/log
build=$work/$target/build
if [[ $target == wasm ]]; then
  # What l4d.wasm links, and beside it a build with tests: all that the module leaves out is there to be compared with.
  prefix=$root/build/wasm-prefix
  export PKG_CONFIG_LIBDIR=$prefix/lib/pkgconfig
  echo "== l4d.wasm, then tests of its decoder"
  quietly "$log" "$root/web/build.sh" wasm
  (cd "$root" && quietly "$log" cmake --preset wasm -B "$build" -DL4D_BUILD_TESTS=ON \
    -DGTest_DIR="$prefix/lib/cmake/GTest" "${options[@]:1}")
  quietly "$log" cmake --build "$build" -j "$jobs" --target l4d_digest l4d_answer l4d_loops_test
else
  echo "== dependencies for $target"
  quietly "$log" cmake -S "$here/dependencies" -B "$work/$target/dependencies" -G Ninja \
    -DCMAKE_BUILD_TYPE=Release -DCMAKE_INSTALL_PREFIX="$prefix" -DSOURCES="$sources" \
    -DGOOGLETEST=/usr/src/googletest -DFLATBUFFERS=/usr/include/flatbuffers "${options[@]}"
  quietly "$log" cmake --build "$work/$target/dependencies" -j "$jobs" --target install
  echo "== decoder and tests for $target"
  quietly "$log" cmake -S "$root" -B "$build" -G Ninja -DCMAKE_BUILD_TYPE=Release \
    "${parts[@]}" -DL4D_BUILD_TESTS=ON -DL4D_TESTS_OF_LOOPS=ON -DL4D_CUDA=OFF \
    -DGTest_DIR="$prefix/lib/cmake/GTest" -DFLATC="$(command -v flatc)" \
    -DCMAKE_FIND_ROOT_PATH="$prefix" -DPKG_CONFIG_EXECUTABLE="$(command -v pkg-config)" "${options[@]}"
  quietly "$log" cmake --build "$build" -j "$jobs"
fi
bin=$build/bin

# all_named BUILD: every source that a build read is an input of this test, or it would be skipped where one has changed.
all_named() {
  local file input
  [[ $(sources_of "$1" | wc -l) -gt 0 ]] || { echo "FAIL: $1 says of no source that it read it" >&2 && exit 1; }
  while read -r file; do
    for input in $L4D_INPUTS; do
      [[ $file != "$input" && $file != "$input"/* ]] || continue 2
    done
    echo "FAIL: tests/cross/CMakeLists.txt does not name $file among the inputs of cross/$target" >&2
    exit 1
  done < <(sources_of "$1")
}
# Of the tree, from its root on. A compiler cache makes paths relative to the build.
sources_of() {
  ninja -C "$1" -t deps | sed -n 's/^ \+//p' | sort -u | (cd "$1" && xargs -d '\n' realpath -m --relative-to="$root") |
    grep -v '^\(\.\.\|build\)/' | sort -u
}
if [[ -n ${L4D_INPUTS:-} ]]; then
  all_named "$build"
  [[ $target != wasm ]] || all_named "$root/build/wasm"
fi

"$here/streams.sh" "$work/streams" "$tool"
mapfile -t streams <"$work/streams/list"

if [[ -n $bench ]]; then
  echo "milliseconds of decoding all, one thread, best of 9"
  join -j 1 <("$digest" --bench "${streams[@]}" | sort) \
    <("${emulator[@]}" "$bin/l4d_digest$suffix" --bench "${streams[@]}" | sort) |
    awk -v target="$target" '
      BEGIN { printf "%-36s %8s %8s %7s\n", "stream", "native", target, "ratio" }
      { printf "%-36s %8.1f %8.1f %7.2f\n", $1, $2, $3, $3 / $2 }'
  exit
fi

if [[ $target == mingw ]]; then
  # Files, threads and the whole C API as a program there sees them.
  echo "== programs of the C API for $target"
  for program in end_to_end render_end_to_end; do
    quietly "$log" x86_64-w64-mingw32-gcc-posix -std=c99 -DL4D_STATIC_DEFINE -D__USE_MINGW_ANSI_STDIO=1 \
      -I "$root/include" "$root/tests/api/$program.c" -o "$bin/$program.exe" \
      "$build/render/libl4drender.a" "$build/api/libl4dencoder.a" \
      "$build/api/libl4dcodec.a" -L "$prefix/lib" -lzstd -lxxhash -lhwy -static -lstdc++
    (cd "$work/$target" && "${emulator[@]}" "$bin/$program.exe") ||
      { echo "FAIL: $program on $target" >&2; exit 1; }
    echo "$program: passed"
  done
fi

echo "== inner loops on $target"
"${emulator[@]}" "$bin/l4d_loops_test$suffix" --gtest_brief=1
echo "== digests"
# Streams that once went wrong, and damaged ones: the same errors everywhere.
damaged=()
for i in 1 2 3 4 5 6 7 8; do
  stream=$work/$target/damaged-$i.l4d
  cp "$work/streams/default.l4d" "$stream"
  printf '\377' | dd of="$stream" bs=1 seek=$((i * $(stat -c %s "$stream") / 9)) conv=notrunc status=none
  damaged+=("$stream")
done
streams+=("${damaged[@]}" "$root"/tests/fuzz/regress/decode/*)
"$digest" "${streams[@]}" >"$work/$target/native.txt"
# Windows ends lines its own way.
"${emulator[@]}" "$bin/l4d_digest$suffix" "${streams[@]}" | tr -d '\r' >"$work/$target/digest.txt"
diff -u "$work/$target/native.txt" "$work/$target/digest.txt" >&2 || {
  echo "FAIL: streams decode to something else on $target (+) than here (-)" >&2
  exit 1
}
grep -E ' simd all ' "$work/$target/digest.txt"
# Both backends of each stream agree, or the lines above mean little.
sed -n 's/ reference / /p' "$work/$target/digest.txt" >"$work/$target/reference.txt"
sed -n 's/ simd / /p' "$work/$target/digest.txt" | diff - "$work/$target/reference.txt" >&2 || {
  echo "FAIL: SIMD and reference differ on $target" >&2
  exit 1
}
echo "$(wc -l <"$work/$target/digest.txt") lines of digests equal on $target and here"

echo "== conformance suite"
suite=$(python3 -B "$root/conformance/run.py" --quiet -j "$jobs" --adapter "$root/conformance/adapters/batch.py" \
  -- "${emulator[@]}" "$bin/l4d_answer$suffix" 2>&1) || {
  echo "$suite" >&2
  echo "FAIL: the conformance suite on $target" >&2
  exit 1
}
tail -n 1 <<<"$suite"

#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: run.sh static|shared BUILD_DIR [SOURCE_DIR]
# Installs BUILD_DIR into a temporary prefix and checks the file list, the symbols, the pkg-config file
# and the CMake package. With SOURCE_DIR, BUILD_DIR is first made: the library alone, of that kind.
# L4D_UPDATE_GOLDEN=1 rewrites the lists instead of comparing.
set -euo pipefail

kind=$1
build=$2
here=$(cd "$(dirname "$0")" && pwd)
jobs=${L4D_JOBS:-$(nproc)}

fail() {
  echo "FAIL: $*" >&2
  exit 1
}

cache_value() { sed -n "s/^$1:[A-Z]*=//p" "$build/CMakeCache.txt"; }

# compare NAME: standard input against the stored list NAME.
compare() {
  if [[ ${L4D_UPDATE_GOLDEN:-0} == 1 ]]; then
    cat >"$here/$1"
  else
    diff -u "$here/$1" - >&2 || fail "$1 differs (< stored, > this build)"
  fi
}

if [[ $# -ge 3 ]]; then
  shared=OFF
  [[ $kind == shared ]] && shared=ON
  cmake -S "$3" -B "$build" -G Ninja -DCMAKE_BUILD_TYPE=Release -DBUILD_SHARED_LIBS=$shared \
    -DL4D_BUILD_CLI=OFF -DL4D_BUILD_TESTS=OFF -DL4D_BUILD_BENCH=OFF -DL4D_CUDA=OFF \
    -DCMAKE_CXX_COMPILER_LAUNCHER="${L4D_COMPILER_LAUNCHER:-}"
  cmake --build "$build" -j "$jobs"
fi

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
prefix=$work/prefix
cmake --install "$build" --prefix "$prefix" >"$work/install.log"
libdir=$(cache_value CMAKE_INSTALL_LIBDIR)
library=$prefix/$libdir
version=$(sed -n 's/^CMAKE_PROJECT_VERSION:STATIC=//p' "$build/CMakeCache.txt")
[[ -n $version ]] || fail "no version in $build/CMakeCache.txt"
cc=$(cache_value CMAKE_C_COMPILER)
cxx=$(cache_value CMAKE_CXX_COMPILER)

echo "== files"
(cd "$prefix" && find . -type f -o -type l) |
  sed -e 's|^\./||' -e "s|^$libdir/|LIBDIR/|" -e 's|-release\.cmake$|-CONFIG.cmake|' \
    -e 's|-debug\.cmake$|-CONFIG.cmake|' -e "s|$version|VERSION|" |
  grep -v '^bin/l4dcodec$' | LC_ALL=C sort | compare "files-$kind.txt"
if [[ $(cache_value L4D_BUILD_CLI) == ON ]]; then
  LD_LIBRARY_PATH=$library "$prefix/bin/l4dcodec" version
fi

# The same list for both kinds: what the archive offers as the C API is what the shared object exports,
# and a shared object exports nothing else.
echo "== symbols"
# symbols LIBRARY
symbols() {
  if [[ $kind == shared ]]; then
    nm -D --defined-only "$library/lib$1.so" | awk '$2 != "A" { sub(/@.*/, "", $3); print $3 }'
  else
    nm -g --defined-only "$library/lib$1.a" 2>"$work/nm.log" |
      awk '$2 == "T" && $3 ~ /^l4d_/ { print $3 }'
  fi | LC_ALL=C sort
}
# declared HEADER...
declared() {
  grep -hoE 'L4D_API [^(]*\(' "${@/#/$prefix/include/l4d/}" | grep -oE 'l4d_[a-z0-9_]+\($' | tr -d '(' |
    LC_ALL=C sort
}
symbols l4dcodec | compare symbols.txt
symbols l4drender | compare symbols-render.txt
declared l4d.h decode.h encode.h cuda.h | diff -u - "$here/symbols.txt" >&2 ||
  fail "declared (<) and defined (>) functions differ"
declared render.h cuda_render.h cuda_player.h | diff -u - "$here/symbols-render.txt" >&2 ||
  fail "declared (<) and defined (>) functions of the renderer differ"

echo "== pkg-config"
export PKG_CONFIG_PATH=$library/pkgconfig
static=()
[[ $kind == static ]] && static=(--static)
[[ $(pkg-config --modversion l4dcodec) == "$version" ]] || fail "version in l4dcodec.pc"
for package in l4dcodec l4drender; do
  source=consumer.c
  [[ $package == l4drender ]] && source=consumer_render.c
  read -ra flags <<<"$(pkg-config "${static[@]}" --define-prefix --cflags --libs $package)"
  "$cc" -std=c99 -pedantic -Wall -Wextra -Werror "$here/$source" -o "$work/consumer" "${flags[@]}"
  LD_LIBRARY_PATH=$library "$work/consumer"
done

echo "== find_package"
cmake -S "$here/consumer" -B "$work/consumer-build" -G Ninja -DCMAKE_BUILD_TYPE=Release \
  -DCMAKE_PREFIX_PATH="$prefix" -DCMAKE_CXX_COMPILER="$cxx" -DCMAKE_C_COMPILER="$cc" \
  -DEXPECTED_VERSION="$version" >"$work/configure.log" 2>&1 || {
  cat "$work/configure.log" >&2
  fail "find_package"
}
cmake --build "$work/consumer-build"
"$work/consumer-build/consumer"
echo "install test of the $kind library: ok"

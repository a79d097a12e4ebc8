#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: run.sh headers|library SOURCE_DIR WORK_DIR [OPTION...]
# OPTION: for CMake.
# Whether programs outlive the library that they were compiled for.
#  - headers: those that are stable are what abi.txt says (L4D_UPDATE_GOLDEN=1 writes it anew; from 1.0 on, lines may only
#    be added), and those for C++ mirror all that can fail. Grown as a later version may grow them (grow.py), all have every field and name of today in the same place.
#  - library: programs that are compiled against the headers of today run with a shared library of the
#    grown ones, both under the address sanitizer.
set -euo pipefail

kind=$1
source=$2
work=$3
shift 3
here=$(cd "$(dirname "$0")" && pwd)
jobs=${L4D_JOBS:-$(nproc)}
cc=${CC:-cc}
mkdir -p "$work"
rm -rf "$work/grown" "$work/lost" # headers that are no longer there

python3 -B "$here/grow.py" "$source/include" "$work/grown"

# fields HEADERS [stable]: each struct's size, each field's offset, and each function, as this compiler has them.
fields() {
  python3 -B "$here/fields.py" "$@" >"$work/fields.c"
  "$cc" -I "$1" "$work/fields.c" -o "$work/fields"
  "$work/fields"
}
check_headers() {
  local moved
  fields "$source/include" stable >"$work/abi.txt"
  if [[ ${L4D_UPDATE_GOLDEN:-0} == 1 ]]; then
    cp "$work/abi.txt" "$here/abi.txt"
  elif [[ $(uname -sm) == 'Linux x86_64' ]]; then
    diff -u "$here/abi.txt" "$work/abi.txt" >&2 || { echo "FAIL: the stable interface has changed" >&2; exit 1; }
  fi
  # What returns a status fails, or owns, and has a method.
  local name
  while read -r _ name; do
    grep -qw "$name" "$source"/include/l4d/*.hpp || { echo "FAIL: no header for C++ has $name" >&2; exit 1; }
  done < <(grep -oE '\bl4d_status l4d_\w+' "$work/abi.txt")
  fields "$source/include" >"$work/today.txt"
  fields "$work/grown" >"$work/grown.txt"
  moved=$(comm -23 <(sort "$work/today.txt") <(sort "$work/grown.txt"))
  if [[ -n $moved ]]; then
    echo "FAIL: the grown headers have these fields or names elsewhere:" >&2
    echo "$moved" >&2
    exit 1
  fi
  echo "$(wc -l <"$work/today.txt") fields and names are where they were"

  # The check above can fail: fields that a struct loses are seen.
  mkdir -p "$work/lost/l4d"
  cp -r "$source"/include/l4d/. "$work/lost/l4d/"
  sed 's/ uint64_t file_bytes;//' "$source/include/l4d/decode.h" >"$work/lost/l4d/decode.h"
  fields "$work/lost" >"$work/lost.txt"
  [[ -n $(comm -23 <(sort "$work/today.txt") <(sort "$work/lost.txt")) ]] ||
    { echo "FAIL: a lost field is not seen" >&2; exit 1; }
}

case $kind in
  headers)
    check_headers
    exit
    ;;
  library) ;;
  *) echo "unknown kind $kind" >&2 && exit 2 ;;
esac

# One SIMD target is enough, and the plain one compiles fastest.
cmake -S "$source" -B "$work/build" -G Ninja "$@" -DL4D_WERROR=OFF -DCMAKE_BUILD_TYPE=Debug -DBUILD_SHARED_LIBS=ON \
  -DL4D_PUBLIC_HEADERS="$work/grown" -DL4D_SANITIZE=address -DL4D_CUDA=OFF -DL4D_BUILD_CLI=OFF \
  -DL4D_BUILD_TESTS=OFF -DL4D_BUILD_BENCH=OFF \
  -DCMAKE_CXX_FLAGS="-g0 -O0 -DHWY_COMPILE_ONLY_SCALAR" >"$work/configure.log"
cmake --build "$work/build" -j "$jobs"
library=$(dirname "$(find "$work/build" -name 'libl4dcodec.so' | head -1)")

for program in "$here/program.c" "$source/tests/api/end_to_end.c" \
  "$source/tests/api/render_end_to_end.c"; do
  name=$(basename "$program" .c)
  "$cc" -std=c99 -g -fsanitize=address -I "$source/include" "$program" \
    -o "$work/$name" -L "$library" -ll4dencoder -ll4drender -ll4dcodec -lm
  (cd "$work" && LD_LIBRARY_PATH=$library "./$name") || { echo "FAIL: $name" >&2; exit 1; }
done

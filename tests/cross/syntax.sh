#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: syntax.sh GENERATED
# The compilers of other architectures read the decoder, and make code of its vectors alone: what does not compile
# for aarch64 or Windows is found here. What computes something else there is found by run.sh, at night.
# GENERATED: the folder of l4d_generated.h.
set -euo pipefail
generated=${1:?"usage: syntax.sh GENERATED"}
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
sources=${L4D_CROSS_SOURCES:-$root/build/cross-sources}

skip() {
  echo "skipped: $* (./dev setup compilers)"
  exit 77
}
for package in libzstd xxhash highway; do
  [[ -d $sources/$package ]] || skip "no sources of $package in $sources"
done
cd "$root"
includes=(-I. -Iinclude "-isystem$generated" "-isystem$sources/libzstd/lib" "-isystem$sources/xxhash"
  "-isystem$sources/highway")
# The host's FlatBuffers are headers alone; its other headers are of no use to another compiler.
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
ln -s /usr/include/flatbuffers "$work/flatbuffers"
includes+=("-isystem$work")

# check COMPILER OTHER: reads all sources but device code and OTHER, which is for another system.
check() {
  local compiler=$1 other=$2 files
  command -v "$compiler" >/dev/null || skip "no $compiler"
  mapfile -t files < <(find libl4dcodec decoder api -name '*.cc' -not -path '*/cuda/*' \
    -not -path "*/$other" | sort)
  local flags=(-std=c++17 -DL4D_STATIC_DEFINE "-DHWY_DISABLED_TARGETS=(HWY_SVE|HWY_SVE2|HWY_SVE_256|HWY_SVE2_128)"
    -ffp-contract=off -Wall -Wextra -Werror "${includes[@]}")
  printf '%s\0' "${files[@]}" | xargs -0 -n 8 -P "${L4D_JOBS:-$(nproc)}" "$compiler" -fsyntax-only "${flags[@]}"
  echo "$compiler reads ${#files[@]} files"
  # Whether what must be inlined can be is known when code is made; this machine makes that of Windows, too.
  [[ $compiler == aarch64-* ]] || return 0
  printf '%s\0' "${files[@]}" | grep -z '_simd[.]cc$' |
    xargs -0 -n 1 -P "${L4D_JOBS:-$(nproc)}" "$compiler" -c -O1 -o /dev/null "${flags[@]}"
}
check aarch64-linux-gnu-g++ base/atomic_file_win32.cc
check x86_64-w64-mingw32-g++-posix base/atomic_file.cc

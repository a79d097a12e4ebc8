#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The decoder as several compilers make it, at the ends of their optimisation, on every SIMD target,
# number of threads and rounding mode for small numbers: all give the same bytes.
#
# usage: compilers.sh GENERATED NUMERICS_TEST [GCC_O3]
#   GENERATED      the folder of l4d_generated.h
#   NUMERICS_TEST  the program that writes the streams
#   GCC_O3         decode_hash of a build with g++ -O3; without it, one is compiled
set -euo pipefail

generated=${1:?"usage: compilers.sh GENERATED NUMERICS_TEST [GCC_O3]"}
numerics_test=${2:?"usage: compilers.sh GENERATED NUMERICS_TEST [GCC_O3]"}
gcc_o3=${3:-}
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)

for compiler in g++ clang++; do
  if ! command -v "$compiler" >/dev/null; then
    echo "skipped: no $compiler"
    exit 77
  fi
done

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

launcher=()
if command -v ccache >/dev/null; then launcher=(ccache); fi

# The decode path alone: what both directions share, the decoder, and its entry points.
sources=("$root"/libl4dcodec/{base,container,entropy,quant}/*.cc "$root"/decoder/{read,expand,session,check}/*.cc
  "$root"/api/{common,decode_api}.cc "$root"/tests/numerics/compilers/decode_hash.cc)
for i in "${!sources[@]}"; do
  if [[ ${sources[i]} == *_win32.cc ]]; then unset "sources[i]"; fi
done
flags=(-std=c++17 -ffp-contract=off -pthread -w -I"$root" -I"$root/include" -I"$generated")
libraries=(-lhwy -lzstd -lxxhash)

# compile NAME COMPILER OPTION...
compile() {
  local name=$1 compiler=$2 folder=$work/$1 source object
  shift 2
  mkdir -p "$folder"
  for source in "${sources[@]}"; do
    object=${source#"$root"/} # base names are not unique
    printf '%s\0-o\0%s\0' "$source" "$folder/${object//\//_}.o"
  done | xargs -0 -n 3 -P "${L4D_JOBS:-$(nproc)}" \
    "${launcher[@]}" "$compiler" "$@" "${flags[@]}" -c
  "$compiler" -pthread "$folder"/*.o "${libraries[@]}" -o "$work/$name.bin"
}

mkdir "$work/streams"
"$numerics_test" --streams "$work/streams"

builds=(gcc-O0 gcc-O3 clang-O3)
compile gcc-O0 g++ -O0
if [[ -n $gcc_o3 ]]; then
  ln -s "$gcc_o3" "$work/gcc-O3.bin"
else
  compile gcc-O3 g++ -O3
fi
compile clang-O3 clang++ -O3

: >"$work/lines"
for name in "${builds[@]}"; do
  while read -r target; do
    "$work/$name.bin" "$target" "$work"/streams/*.l4d | sed "s/^/$name /" >>"$work/lines"
  done < <("$work/$name.bin" --targets)
done

# build stream target threads ftz gaussians slices
awk '
  BEGIN {
    printf "%-10s %-14s %-10s %7s %4s  %-16s  %-16s\n",
           "build", "stream", "target", "threads", "ftz", "gaussians", "slices"
  }
  {
    # Runs that differ in nothing but threads and ftz take one line where they agree.
    key = $1 " " $2 " " $3
    if (!(key in runs)) order[++keys] = key
    ++runs[key]
    if (!(key in hashes)) hashes[key] = $6 " " $7
    if (hashes[key] != $6 " " $7) bad[key] = 1
    detail[key] = detail[key] $0 "\n"
    # Gaussians are normative: one value for all. Slices are one value for each build.
    if (!($2 in gaussians)) gaussians[$2] = $6
    if (gaussians[$2] != $6) wrong = 1
    if (!(($1, $2) in slices)) slices[$1, $2] = $7
    if (slices[$1, $2] != $7) wrong = 1
  }
  END {
    for (i = 1; i <= keys; ++i) {
      split(order[i], k, " ")
      split(bad[order[i]] ? "DIFFER" : hashes[order[i]], h, " ")
      printf "%-10s %-14s %-10s %7s %4s  %-16s  %-16s\n",
             k[1], k[2], k[3], "1 2 7", "both", h[1], h[2]
      if (bad[order[i]]) printf "%s", detail[order[i]]
      total += runs[order[i]]
    }
    printf "%d decodes, %s\n", total, wrong ? "NOT EQUAL" : "all equal"
    exit wrong || total < 3 * 3 * 6 * 2
  }' "$work/lines"

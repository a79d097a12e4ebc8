#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: architectures.sh NVCC
# Device code compiles for devices that lack what newer ones have: 7.5 has no copies beside other
# work, 8.0 no kernels that overlap. A development build is for one kind of device; this compiles the
# rest as far as PTX.
set -euo pipefail
nvcc=${1:?"usage: architectures.sh NVCC"}
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

cd "$root"
mapfile -t sources < <(find libl4dcodec decoder encoder render -name '*.cu')
[[ ${#sources[@]} -gt 0 ]]
for architecture in 75 80; do
  for source in "${sources[@]}"; do
    printf '%s\0-o\0%s\0-arch=compute_%s\0' "$source" "$work/${source//\//_}.$architecture.ptx" \
      "$architecture"
  done
done | xargs -0 -n 4 -P "${L4D_JOBS:-$(nproc)}" "$nvcc" -ptx -std=c++17 --expt-relaxed-constexpr \
  -I. -Iinclude -DL4D_HAVE_CUDA -DL4D_CUDA_MIN_OVERLAPPING=90
echo "${#sources[@]} files compile for 7.5 and 8.0"

#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Machines on which a stream would decode to something else are refused when the build is configured.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# refused MESSAGE CMAKE_ARGUMENT...
refused() {
  local message=$1
  shift
  rm -rf "$work/build"
  if cmake -S "$here/../.." -B "$work/build" -G Ninja -DL4D_CUDA=OFF "$@" >"$work/log" 2>&1; then
    echo "FAIL: configured with $*" >&2
    exit 1
  fi
  tr -s '\n ' ' ' <"$work/log" | grep -qF -- "$message" || {
    cat "$work/log" >&2
    echo "FAIL: not refused as '$message'" >&2
    exit 1
  }
  echo "refused: $message"
}

tried=0
if command -v s390x-linux-gnu-g++ >/dev/null; then
  refused 'does not run on big-endian machines (s390x)' -DCMAKE_TOOLCHAIN_FILE="$here/s390x.cmake"
  tried=1
else
  echo "skipped: no s390x-linux-gnu-g++ (./dev setup cross)"
fi
if [[ $(uname -m) == x86_64 ]]; then
  refused 'calculates with more digits' -DCMAKE_CXX_FLAGS=-mfpmath=387
  tried=1
fi
[[ $tried == 1 ]] || exit 77

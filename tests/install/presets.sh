#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: presets.sh FOLDER SOURCE_DIR [OPTION...]
# Configures, with OPTION for CMake, the presets that no other test builds as they are: with all of their tests, and as on
# a machine that has no CUDA compiler.
set -euo pipefail
rm -rf "$1"
for preset in shared no-cuda; do
  CUDACXX=none cmake -S "$2" -B "$1/$preset" --preset "$preset" -DL4D_CUDA=AUTO -DCMAKE_CUDA_COMPILER=NOTFOUND \
    "${@:3}" >"$1.log" 2>&1 || {
    cat "$1.log" >&2
    echo "FAIL: the preset $preset" >&2
    exit 1
  }
done
rm -rf "$1" "$1.log"

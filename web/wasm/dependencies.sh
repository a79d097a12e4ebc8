#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: dependencies.sh PREFIX WORK_DIR
# Builds zstd, xxHash and Highway for WebAssembly into PREFIX, from the sources that
# `./dev setup cross` or `./dev setup web` has fetched (L4D_CROSS_SOURCES says where they are), and
# GoogleTest for tests/cross, where its sources are installed.
set -euo pipefail
prefix=${1:?"usage: dependencies.sh PREFIX WORK_DIR"} work=${2:?}
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
root=$(cd "$here/../.." && pwd)
sources=${L4D_CROSS_SOURCES:-$root/build/cross-sources}
unset CFLAGS CXXFLAGS LDFLAGS
export NODE_PATH=${NODE_PATH:-/usr/share/nodejs}
# Of zstd's ways to decompress the small ones: default streams use it for a few tables.
small='-Os -DNDEBUG -DHUF_FORCE_DECOMPRESS_X1 -DZSTD_FORCE_DECOMPRESS_SEQUENCES_SHORT'
small+=' -DZSTD_NO_INLINE -DZSTD_STRIP_ERROR_STRINGS=1'
launcher=()
if command -v ccache >/dev/null; then
  launcher=(-DCMAKE_C_COMPILER_LAUNCHER=ccache -DCMAKE_CXX_COMPILER_LAUNCHER=ccache)
fi
googletest=/usr/src/googletest
[[ -d $googletest ]] || googletest=''
cmake -S "$root/tests/cross/dependencies" -B "$work" -G Ninja -DCMAKE_BUILD_TYPE=Release \
  -DCMAKE_TOOLCHAIN_FILE="$here/toolchain.cmake" -DCMAKE_INSTALL_PREFIX="$prefix" \
  -DCMAKE_C_FLAGS_RELEASE="$small" -DSOURCES="$sources" -DGOOGLETEST="$googletest" -DFLATBUFFERS=/usr/include/flatbuffers "${launcher[@]}"
cmake --build "$work" -j "${L4D_JOBS:-$(nproc)}" --target install

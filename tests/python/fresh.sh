#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# How long it takes from a fresh Debian to the first splats in Python: prints the seconds of each step.
# usage: fresh.sh FOLDER STREAM [WHEEL]
# FOLDER: a Debian that `debootstrap --variant=minbase bookworm FOLDER` has just made. Needs root.
# Without WHEEL, the package is built in it from this tree.
set -euo pipefail
folder=$1 stream=$2 wheel=${3:-}
source=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)

# step COMMAND...: runs it in the folder
step() {
  local begin
  begin=$(date +%s%N)
  chroot "$folder" env DEBIAN_FRONTEND=noninteractive "$@" >"$folder/root/log" 2>&1 || {
    tail -20 "$folder/root/log"
    exit 1
  }
  printf '%8.1f s  %s\n' "$((($(date +%s%N) - begin) / 100000000))e-1" "$*"
}

install -D "$stream" "$folder/root/scene.l4d"
path=
if [[ -n $wheel ]]; then
  cp "$wheel" "$folder/root"
  step apt-get update -q
  step apt-get install -y -q --no-install-recommends python3-numpy python3-cffi python3-pip
  step pip install --break-system-packages --no-deps "/root/$(basename "$wheel")"
else
  mkdir -p "$folder/root/l4dcodec"
  git -C "$source" archive HEAD | tar -x -C "$folder/root/l4dcodec"
  path=/root/l4dcodec/build/release/python
  step /root/l4dcodec/dev setup build python
  step cmake -S /root/l4dcodec -B /root/l4dcodec/build/release -G Ninja -DL4D_PYTHON=ON
  step cmake --build /root/l4dcodec/build/release --target python
fi
step env PYTHONPATH="$path" python3 -c 'import l4dcodec; print(l4dcodec.open("/root/scene.l4d").slice(1.5))'
cat "$folder/root/log"

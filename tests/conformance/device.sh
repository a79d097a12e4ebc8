#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: device.sh ANSWER RUNNER.. : the suite on a CUDA device. Exits with 77 where there is none.
set -euo pipefail
answer=$1
shift
status=0
said=$("$answer" --backend cuda --batch 2>&1 </dev/null) || status=$?
if [[ $status == 3 && $said == *"no CUDA device"* ]]; then
  echo "skipped: no CUDA device"
  exit 77
fi
exec "$@" "$answer" --backend cuda

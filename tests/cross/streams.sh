#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: streams.sh FOLDER TOOL
# Encodes the streams that run.sh decodes on other architectures, unless they are newer than TOOL; FOLDER/list
# names them. The tests of all architectures share them; one makes them while the others wait.
set -euo pipefail
folder=$(realpath -m "${1:?"usage: streams.sh FOLDER TOOL"}") tool=$(realpath "${2:?}")
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
data=${L4D_DATA_DIR:-$root/../shared/data}

# encode SCENE NAME OPTION...: makes NAME.l4d.
encode() {
  local scene=$1 stream=$folder/$2.l4d
  shift 2
  streams+=("$stream")
  [[ $stream -nt $tool && $stream -nt $scene ]] && return
  "$tool" encode "$scene" "$@" --set prune-weight=-1 -q -f -o "$stream"
}
mkdir -p "$folder"
exec 9>"$folder/lock"
flock 9
streams=()
scene=$folder/scene.ply
[[ $scene -nt $tool ]] || "$tool" synth --scene cloud --seconds 4 --fps 30 --gaussians 6000 --seed 3 -q -f -o "$scene"
for preset in default tiny small large archive indexed indexed-small indexed-high paper-small paper-large lossless; do
  encode "$scene" "$preset" --preset "$preset"
done
trained=$data/basketball/basketball.ply
if [[ -f $trained ]]; then
  for preset in default small indexed lossless; do
    encode "$trained" "basketball-$preset" --preset "$preset"
  done
else
  echo "SKIPPED: streams of basketball: no $trained"
fi
printf '%s\n' "${streams[@]}" >"$folder/list.part"
mv "$folder/list.part" "$folder/list"

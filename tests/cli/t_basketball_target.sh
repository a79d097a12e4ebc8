# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# Targets on a real scene.
need_data basketball/basketball.ply
scene=$DATA/basketball/basketball.ply

encode() {
  expect_document 0 encode "$scene" -o b.l4d --weights "$DATA/basketball/basketball-weights.ply" \
    --force "$@"
  expect_json out 'd["target"]["met"] and len(d["target"]["trials"]) <= 10'
}
for size in 2MB 6MB; do
  encode --target-size $size
  expect_json out "0.98 * ${size%MB}e6 <= d['file_bytes'] <= ${size%MB}e6 and 'obstacle' not in d['target']"
done
encode --target-bitrate 4Mbit/s
expect_json out '0.98 * 2.5e6 <= d["file_bytes"] <= 2.5e6'
cameras=$DATA/basketball/cameras.json
encode --target-fidelity 36dB --cameras "$cameras" --frames 0:150:50
expect_json out 'd["target"]["views"] == 12 and d["target"]["reached"] >= 36'
expect_document 0 compare "$scene" b.l4d --cameras "$cameras" --frames 0:150:50 --min-fidelity 36

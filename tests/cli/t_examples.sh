# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# The example programs: what they do in C, they do in C++.
folder=$(dirname "$L4DCODEC")
[ -x "$folder/l4d_example_draw_instant" ] || skip "this build has no encoder or no renderer"
for kind in '' _cpp; do
  "$folder/l4d_example_encode_arrays$kind" "scene$kind.l4d" > out || die "nothing is encoded: $(cat out)"
  expect_text out ': 100 %$'
  expect_text out '^600 Gaussians in [1-9][0-9]* bytes$'
  l4d validate "scene$kind.l4d" > log
  for time in 0.2 1.5; do
    "$folder/l4d_example_draw_instant$kind" scene.l4d $time "at_$time$kind.ppm" || die "nothing is drawn"
  done
  if "$folder/l4d_example_draw_instant$kind" out 1 none.ppm 2> err; then die "a text is drawn"; fi
  expect_text err '^draw_instant: .*spec FILE-1 '
done
cmp at_1.5.ppm at_1.5_cpp.ppm
if cmp -s at_0.2.ppm at_1.5.ppm; then die "all instants look the same"; fi

[ -x "$folder/l4d_example_decode_to_device" ] || exit 0
for kind in '' _cpp; do
  status=0
  "$folder/l4d_example_decode_to_device$kind" scene.l4d > out 2> err || status=$?
  case $status in
    0) expect_text out '^600 Gaussians, [1-9][0-9]* bytes sent to the device' ;;
    77) expect_text err 'no CUDA device$' ;;
    *) die "decoding on a device fails: $(cat err)" ;;
  esac
done

# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# What encode --level promises holds for every preset, says the decoder in conformance/reference, which
# counts for itself; what it cannot keep it refuses.
l4d synth --scene cloud -q -n 4000 --seconds 2 --fps 30 --seed 7 -o short.ply
l4d synth --scene cloud -q -n 20000 --static-gaussians 2000 --seconds 60 --fps 25 --seed 8 -o busy.ply
l4d synth --scene cloud -q -n 101000 --seconds 1 --fps 1 --effects static,rigid --seed 9 -o large.ply

# demand FILE: the lowest level that the stream keeps to.
demand() {
  "$PYTHON" -B "$ROOT/conformance/reference/l4d.py" --query demand "$1" |
    "$PYTHON" -c 'import json, sys; print(json.load(sys.stdin)["demand"]["level"])'
}

presets='tiny small default large archive indexed indexed-small indexed-high lossless paper-small paper-large'
kept=0 refused=0
for scene in short busy large; do
  # The limit of Gaussians is that of any preset.
  [ "$scene" != large ] || presets='tiny indexed lossless'
  for preset in $presets; do
    more=()
    # Those of the paper prune by weights that no camera measured here.
    [ "${preset#paper}" = "$preset" ] || more=(--set prune-weight=-1)
    for level in 1 2; do
      rm -f x.l4d
      status=0
      l4d encode -q $scene.ply -o x.l4d --preset "$preset" -e 1 --level $level "${more[@]}" 2> err || status=$?
      if [ "$status" -eq 6 ]; then
        expect_missing x.l4d
        grep -q 'more than the limit of' err || die "$scene, $preset, level $level: $(cat err)"
        refused=$((refused + 1))
        continue
      fi
      [ "$status" -eq 0 ] || die "$scene, $preset, level $level: status $status, $(cat err)"
      expect 0 validate x.l4d --level $level
      needed=$(demand x.l4d)
      if [ "$needed" -lt 1 ] || [ "$needed" -gt $level ]; then
        die "$scene, $preset: declared $level, needs $needed"
      fi
      kept=$((kept + 1))
      break # what keeps to a level keeps to higher ones
    done
  done
done
# Both happen: the large scene has more Gaussians than level 1 allows.
[ "$kept" -eq 25 ] || die "$kept streams keep to level 1 or 2"
[ "$refused" -ge 3 ] || die "$refused refused"

# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# Verbs take what other verbs write: scenes that last long enough for their times to need doubles, too.
num_inputs=0
for seconds in 1 60 600; do
  expect 0 synth --scene cloud --seconds $seconds -n 2k -o s.ply -f
  expect 0 encode s.ply -o s.l4d -f
  expect 0 cut s.l4d --from "$("$PYTHON" -c "print($seconds * 0.4)")" -o piece.l4d -f
  for input in s piece; do
    expect 0 encode $input.l4d -o again.l4d -f
    expect_document 0 validate again.l4d
    expect 0 encode --live $input.l4d -o live.l4d -f
    expect_document 0 validate live.l4d
    expect 0 remux live.l4d -o remuxed.l4d -f
    expect 0 repair live.l4d -o repaired.l4d -f
    expect 0 concat again.l4d again.l4d -o twice.l4d -f
    for output in remuxed repaired twice; do
      expect_document 0 validate $output.l4d
    done
    # The new stream has the Gaussians that its source has.
    wanted=$(json <(l4d info $input.l4d --json) 'd["num_gaussians"]')
    expect_equal "$(json <(l4d info again.l4d --json) 'd["num_gaussians"]')" "$wanted"
    num_inputs=$((num_inputs + 1))
  done
done
expect_equal "$num_inputs" 6

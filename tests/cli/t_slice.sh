# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# slice and decode of parts.
make_scene s.ply 5000
# Layers as fine as they come: so small a scene would get one layer otherwise.
expect 0 encode s.ply -o s.l4d --preset lossless --set merge-count=0 --set merge-fraction=0
expect_document 0 slice s.l4d --time 1 -o one.ply
expect_json out 'd["num_frames"] == 1 and d["frames"][0]["time"] == 1'
visible=$(json out 'd["frames"][0]["gaussians"]')
expect_text one.ply "^element vertex $visible\$"
for property in x y z f_dc_0 opacity scale_0 scale_2 rot_0 rot_3 f_rest_44; do
  expect_text one.ply "^property float $property\$"
done
expect_document 0 info s.l4d --time 1
expect_json out "d['seek']['visible'] == $visible"
# The PLY itself slices to the same.
expect 0 slice s.ply --time 1 -o direct.ply
expect 0 encode s.ply -o plain.l4d --preset lossless
expect 0 slice plain.l4d --time 1 -o plain.ply
cmp plain.ply direct.ply

# A sequence: numbered from 0, its end not a frame of it, each bucket decoded once.
expect_document 0 slice s.l4d --from 0.5 --to 1.5 --fps 10 -o f_%03d.ply
expect_json out 'd["num_frames"] == 10 and [f["index"] for f in d["frames"]] == list(range(10))'
expect_json out 'd["frames"][5]["time"] == 1 and d["frames"][5]["output"] == "f_005.ply"'
expect_json out 'd["cache_hits"] > 0'
cmp one.ply f_005.ply
expect_missing f_010.ply
buckets=$(json out 'd["buckets_decoded"]')
expect_document 0 slice s.l4d --from 0.5 --to 1.5 --fps 20 -o g_%d.ply
# Twice the instants, but not twice the buckets.
expect_json out "d['num_frames'] == 20 and d['buckets_decoded'] < 1.5 * $buckets + 4"
expect_document 0 slice s.l4d --fps 5 -o h_%02d%%.ply
expect_json out 'd["num_frames"] == 10 and d["frames"][9]["output"] == "h_09%.ply"'
# Without times, all frames, as `convert` writes them.
expect_document 0 slice s.l4d -o all_%d.ply
expect_json out 'd["num_frames"] == 60 and d["frames"][59]["output"] == "all_59.ply"'
cmp all_30.ply one.ply
expect_document 0 slice s.l4d --digest
expect_json out 'd["num_frames"] == 60'
# Nothing is written where one of the names exists.
rm f_00*.ply
touch f_003.ply
expect 3 slice s.l4d --from 0.5 --to 1.5 --fps 10 -o f_%03d.ply
expect_missing f_000.ply

# decode of a time or range holds at least what is visible there.
expect_document 0 decode s.l4d --time 1 -o part.ply
part=$(json out 'd["num_gaussians"]')
if [ "$part" -lt "$visible" ] || [ "$part" -ge 5000 ]; then die "$part Gaussians at 1 s"; fi
expect_document 0 decode s.l4d --from 0.9 --to 1.1 -o range.ply
range=$(json out 'd["num_gaussians"]')
if [ "$range" -lt "$part" ] || [ "$range" -gt 5000 ]; then die "$range in the range"; fi
expect 0 slice part.ply --time 1 -o from_part.ply
expect_text from_part.ply "^element vertex $visible\$"
expect_document 0 decode s.l4d --max-level 0 -o coarse.ply
expect_json out 'd["num_gaussians"] < 5000'

# Base colours: the same Gaussians, with other colours. Pages must be large for SH to be apart.
make_scene large.ply 60k
expect 0 encode large.ply -o large.l4d --set coding.sh=1
expect_document 0 slice large.l4d --time 1 -o full.ply
count=$(json out 'd["frames"][0]["gaussians"]')
expect_document 0 slice large.l4d --time 1 --detail base -o base.ply
expect_json out "d['detail'] == 'base' and d['frames'][0]['gaussians'] == $count"
if cmp -s full.ply base.ply; then die 'base colours are the whole'; fi
expect_document 0 decode large.l4d --detail base -o base_scene.ply
expect 0 slice base_scene.ply --time 1 -o from_base.ply
expect_text from_base.ply "^element vertex $count\$"
expect_document 0 render large.l4d --time 1 --detail base -o base.png
expect_json out 'd["detail"] == "base"'
expect 0 render large.l4d --time 1 -o full.png
if cmp -s full.png base.png; then die 'base colours look as the whole'; fi

# Threads and backends agree.
for options in '--threads 1' '--threads 3' '--backend reference' '--backend cpu'; do
  # shellcheck disable=SC2086
  expect 0 slice s.l4d --time 1 -o other.ply --force $options
  cmp one.ply other.ply
done

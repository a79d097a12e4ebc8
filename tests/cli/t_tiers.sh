# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# Tiers from the encoder to what leaves them out.
make_scene scene.ply 20k
expect 0 encode scene.ply -o plain.l4d
expect 0 encode scene.ply -o tiers.l4d --tiers 0.15,0.5
expect 0 encode scene.ply -o same.l4d --set tiers=0.15,0.5
cmp tiers.l4d same.l4d
make_scene few.ply 200
expect 0 encode few.ply -o few.l4d --tiers 0.15,0.5
expect_text err '--tiers: the stream has one tier'
expect 0 validate tiers.l4d

expect_document 0 info plain.l4d
expect_json out 'd["streamable"] and all(l["tier"] == 0 for l in d["layers"])'
expect_document 0 info tiers.l4d
expect_json out 'd["streamable"] and {l["tier"] for l in d["layers"]} == {0, 1, 2}'
expect_json out 'all(l["tier"] == 0 for l in d["layers"] if l["level"] > 0)'
expect_json out '[r["tier"] for r in d["scalable"] if "tier" in r] == [0, 1, 2]'
expect_json out 'sorted(r["bytes"] for r in d["scalable"] if "tier" in r) == [r["bytes"] for r in d["scalable"] if "tier" in r]'
all=$(json out 'd["num_gaussians"]')
first=$(json out 'sum(l["num_gaussians"] for l in d["layers"] if l["tier"] == 0)')
expect 0 info tiers.l4d
expect_text out '^tier 0 '

expect_document 0 decode tiers.l4d --digest --max-tier 0
expect_json out "d['num_gaussians'] == $first"
expect_document 0 decode tiers.l4d --digest
expect_json out "d['num_gaussians'] == $all"
cp out whole
expect_document 0 decode tiers.l4d --digest --max-tier 2
expect_json out "d['digests'] == $(json whole 'd["digests"]')"
for tier in 0 1 2; do
  expect_document 0 slice tiers.l4d --time 1 --max-tier $tier -o "$tier.ply"
  json out 'd["frames"][0]["gaussians"]' >> counts
done
sort -n -c counts
expect_equal "$(sort -n -u counts | wc -l)" 3
expect_document 0 render tiers.l4d --time 1 --max-tier 0 --size 64x48 -o 0.png
expect_document 0 render tiers.l4d --time 1 --size 64x48 -o all.png
if cmp -s 0.png all.png; then die "a tier looks as all of them do"; fi

for bad in 0 1 0.5,0.2 0.5,0.5 x 0.1,0.2,0.3,0.4,0.5,0.6,0.7,0.8; do
  expect 2 encode scene.ply -o bad.l4d --tiers $bad
  expect_missing bad.l4d
done
expect 2 decode tiers.l4d --max-tier -1 --digest

# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# compare --lpips, with random weights.
make_scene s.ply 3000
make_cameras c.json
expect 0 encode s.ply -o s.l4d --preset indexed --codebook all=16 --stages all=1
expect 0 encode s.ply -o fine.l4d --preset indexed --codebook all=1024 --stages all=1,1
"$PYTHON" -B "$ROOT/tests/common/random_alexnet.py" alex.safetensors

# Equal images have the distance 0, coarse coding has a larger one than fine coding.
expect_document 0 compare s.ply s.ply --cameras c.json --frames 7 --lpips alex.safetensors
expect_json out 'd["lpips_alex"] == 0 and "lpips_vgg" not in d and "lpips_alex_a" not in d'
expect_document 0 compare s.ply s.l4d --cameras c.json --frames 0:60:20 --per-view --lpips alex.safetensors
expect_json out 'len({v["lpips_alex"] for v in d["per_view"]}) == 6'
expect_json out 'abs(d["lpips_alex"] - sum(v["lpips_alex"] for v in d["per_view"]) / 6) < 1e-9'
coarse=$(json out 'd["lpips_alex"]')
expect_document 0 compare s.ply fine.l4d --cameras c.json --frames 0:60:20 --lpips alex.safetensors
expect_json out "0 < d['lpips_alex'] < $coarse"
expect 0 compare s.ply s.l4d --cameras c.json --frames 7 --lpips alex.safetensors
expect_text out '^B against A .* LPIPS [(]alex[)] 0[.][0-9]+$'
# Without the option there is no word of it.
expect_document 0 compare s.ply s.l4d --cameras c.json --frames 7 --per-view
expect_equal "$(grep -ci lpips out)" 0

# What cannot be done.
expect 2 compare s.ply s.l4d --lpips alex.safetensors
expect_text err 'need --cameras'
expect 2 compare s.ply s.l4d --orbit 2 --size 64x30 --frames 7 --lpips alex.safetensors
expect_text err 'at least 31 pixels a side; these have 64 x 30'
expect 4 compare s.ply s.l4d --cameras c.json --frames 7 --lpips s.ply
expect_text err 'no .safetensors file'
expect 3 compare s.ply s.l4d --cameras c.json --frames 7 --lpips nowhere
# The network counts against the limit of memory, before it is read.
expect 6 compare s.ply s.l4d --cameras c.json --frames 7 --lpips alex.safetensors --limit-memory 30M
expect_text err 'the network of --lpips needs'
expect 2 compare s.ply s.l4d --cameras c.json --frames 7 --lpips alex.safetensors --side-by-side alex.safetensors
expect_text err 'alex.safetensors'

need_ffmpeg
for k in 0 2; do
  expect 0 render s.ply --cameras c.json --camera $k -o cam$k.mp4 --crf 4
done
expect_document 0 compare s.ply s.l4d --cameras c.json --frames 7 --images --per-view --lpips alex.safetensors
expect_json out '0 < d["lpips_alex_a"] < d["lpips_alex_b"]'
expect_json out 'all(0 < v["lpips_alex_a"] < v["lpips_alex_b"] for v in d["per_view"])'

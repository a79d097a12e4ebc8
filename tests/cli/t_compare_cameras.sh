# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# compare by images.
make_scene s.ply 3000
make_cameras c.json
expect 0 encode s.ply -o s.l4d --preset indexed --codebook all=16 --stages all=1
expect 0 encode s.ply -o fine.l4d --preset indexed --codebook all=1024 --stages all=1,1 --order fine.order

# A scene is equal to itself: the cap of decibels, and SSIM 1.
expect_document 0 compare s.ply s.ply --cameras c.json --frames 0:60:20
expect_json out 'd["views"] == 6 and d["fidelity_db"] == d["min_fidelity_db"] == 100'
expect_json out 'abs(d["ssim"] - 1) < 1e-6 and "attributes" not in d and "psnr_a_db" not in d'

# Coarse coding shows, finer coding less; the worst view is no better than all together.
expect_document 0 compare s.ply s.l4d --cameras c.json --frames 0:60:20 --per-view
expect_json out '10 < d["min_fidelity_db"] <= d["fidelity_db"] < 60 and 0 < d["ssim"] < 1'
expect_json out '[(v["camera"], v["frame"]) for v in d["per_view"]] == [(c, f) for f in (0, 20, 40) for c in (0, 2)]'
expect_json out 'min(v["fidelity_db"] for v in d["per_view"]) == d["min_fidelity_db"]'
# The PSNR of the mean squared error, and not the mean of PSNRs.
"$PYTHON" -c 'import json, math
d = json.load(open("out"))
mse = [10 ** (-v["fidelity_db"] / 10) for v in d["per_view"]]
assert abs(d["fidelity_db"] + 10 * math.log10(sum(mse) / len(mse))) < 1e-6
assert abs(d["ssim"] - sum(v["ssim"] for v in d["per_view"]) / len(mse)) < 1e-9'
coarse=$(json out 'd["fidelity_db"]')
expect_document 0 compare s.ply fine.l4d --cameras c.json --frames 0:60:20
expect_json out "d['fidelity_db'] > $coarse + 3"

# Which views.
expect_document 0 compare s.ply s.l4d --cameras c.json --split all --frames 7
expect_json out 'd["views"] == 4 and d["worst_view"]["frame"] == 7'
expect_document 0 compare s.ply s.l4d --cameras c.json --ids 1,3 --frames 7
expect_json out 'd["views"] == 2 and d["worst_view"]["camera"] in (1, 3)'
expect_document 0 compare s.ply s.l4d --cameras c.json --split train --frames 7:9
expect_json out 'd["views"] == 4'
expect_document 0 compare s.ply s.l4d --orbit 3 --size 64x48 --frames 7
expect_json out 'd["views"] == 3 and any("orbit" in n for n in d["notes"])'
expect 2 compare s.ply s.l4d --cameras c.json --ids 9
expect 2 compare s.ply s.l4d --cameras c.json --frames 60

# Attributes on demand; demands on either.
expect_document 0 compare s.ply fine.l4d --cameras c.json --frames 7 --order fine.order
expect_json out 'd["match"] == "order" and d["matched"] == 3000 and d["fidelity_db"] > 10'
expect_document 0 compare s.ply s.ply --cameras c.json --frames 7 --attributes
expect_json out 'd["match"] == "exact" and d["fidelity_db"] == 100'
expect_document 1 compare s.ply s.l4d --cameras c.json --frames 7 --min-fidelity 90
expect_json out 'd["not_met"] == ["fidelity >= 90 dB"]'
expect 0 compare s.ply s.l4d --cameras c.json --frames 7 --min-fidelity 10
expect_text out '^B against A '

expect 0 compare s.ply s.l4d --cameras c.json --frames 7:9 --side-by-side x.png --per-view
expect_png x.png 288 78
expect_equal "$(grep -Ec '^[02] +[78] ' out)" 4
expect 3 compare s.ply s.l4d --cameras c.json --frames 7 --side-by-side x.png

# A camera without its video is named.
status=0
l4d compare s.ply s.l4d --cameras c.json --frames 7 --images > out 2> err || status=$?
expect_equal "$status" 3
expect_text err 'cam0.mp4'

need_ffmpeg
for k in 0 2; do
  expect 0 render s.ply --cameras c.json --camera $k -o cam$k.mp4 --crf 4
done
expect_document 0 compare s.ply s.l4d --cameras c.json --frames 0:60:20 --images --per-view
expect_json out 'd["psnr_a_db"] > 30 and d["ssim_a"] > 0.9 and d["psnr_b_db"] < d["psnr_a_db"]'
expect_json out 'd["ssim_b"] < d["ssim_a"] and all(v["psnr_a_db"] > 30 for v in d["per_view"])'
"$PYTHON" -c 'import json
d = json.load(open("out"))
mean = sum(v["psnr_b_db"] for v in d["per_view"]) / len(d["per_view"])
assert abs(mean - d["psnr_b_db"]) < 1e-9'
# Frames are those of the views: another instant is another image.
aligned=$(json out 'd["psnr_a_db"]')
make_cameras shifted.json 25
expect_document 0 compare s.ply s.l4d --cameras shifted.json --frames 20:41:20 --images
expect_json out "d['psnr_a_db'] < $aligned - 3"
# A video of another size than the camera's is refused.
expect 2 render s.ply --cameras c.json --camera 0 --scale 0.5 -o cam0.mp4 --force
expect 0 render s.ply --cameras c.json --camera 0 --scale 0.5 -o half.mp4
mv half.mp4 cam0.mp4
expect 4 compare s.ply s.l4d --cameras c.json --frames 7 --images

# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# synth: deterministic, and as asked for.
expect_document 0 synth --scene cloud -n 2k --seconds 3 --fps 29.97 --seed 5 -o a.ply
expect_json out 'd["num_gaussians"] == 2000 and d["fps_rational"] == [30000, 1001]'
expect_json out 'len(d["effects"]) == 6 and d["seed"] == 5'
expect_json out "d['file_bytes'] == $(wc -c < a.ply)"
expect 0 synth --scene cloud -n 2000 --seconds 0:03 --fps 29.97 --seed 5 -o b.ply --threads 1
cmp a.ply b.ply
expect 0 synth --scene cloud -n 2000 --seconds 3 --fps 29.97 --seed 6 -o c.ply
if cmp -s a.ply c.ply; then die "the seed does nothing"; fi
expect_document 0 synth --scene cloud -n 1000 --effects static,rigid -o d.ply
expect_json out 'd["effects"] == ["static", "rigid"] and d["sh_degree"] == 0'
l4d synth --scene cloud -n 1000 --effects static --effects rigid -o - > e.ply 2> err
cmp d.ply e.ply
expect_document 0 synth --scene cloud -n 1000 --seconds 1:00:00 -o long.ply
expect_json out 'd["duration_s"] == 3600 and d["num_frames"] == 108000'
# The room of a longer scene is the same room: of 2000 Gaussians the first 800.
expect 0 synth --scene cloud -n 2000 --static-gaussians 800 --seconds 5 -o short.ply
expect 0 synth --scene cloud -n 3000 --static-gaussians 800 --seconds 10 -o longer.ply
if cmp -s a.ply short.ply; then die "--static-gaussians does nothing"; fi
expect 2 synth --scene cloud -n 2000 --static-gaussians some -o f.ply
expect 2 synth --scene cloud --cameras-out f.json -o f.ply
expect 0 encode long.ply -o long.l4d
expect_document 0 info long.l4d --time 59:59
expect_json out 'd["duration_s"] == 3600 and d["seek"]["time"] == 3599'
expect 0 validate long.l4d
# The square, its cameras, and effects of its own.
expect_document 0 synth -n 3k --seconds 2 --cameras-out square.json -o square.ply
expect_json out 'd["scene"] == "square" and d["num_gaussians"] == 3000 and "drops" in d["effects"]'
expect 0 render square.ply --cameras square.json --camera 0 --time 1 -o square.png
expect 0 synth --scene square -n 3k --seconds 2 -o square1.ply --threads 1
cmp square.ply square1.ply
# The room is another place of the same kind.
expect_document 0 synth --scene room -n 3k --seconds 2 --cameras-out room.json -o room.ply
expect_json out 'd["scene"] == "room" and d["num_gaussians"] == 3000 and "drops" in d["effects"]'
expect 0 render room.ply --cameras room.json --camera 100 --time 1 -o room.png
expect 0 synth --scene room -n 3k --seconds 2 -o room1.ply --threads 1
cmp room.ply room1.ply
expect 2 synth --scene room --effects appear -o f.ply
expect 2 synth --scene room --static-gaussians 10 -o f.ply
expect 2 synth --scene street -o f.ply
expect 2 synth --effects appear -o f.ply
expect 2 synth --static-gaussians 10 -o f.ply

# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# encode --refit: pruning, the fit of opacities, and the fidelity that a preset states.
make_scene s.ply 3000
make_cameras c.json

# By default where the cameras are all there are, with the same bits for any number of threads.
expect_document 0 encode s.ply --cameras c.json --quality 36 -o d.l4d --threads 1
expect_json out 'd["refit"]["views"] >= 60 and d["quality"] == 36 and "target" not in d'
expect_json out 'd["refit"]["reached"] >= 36 and d["pruned"] > 0'
expect_json out 'd["refit"]["thresholds"][d["refit"]["chosen"]]["passes"] == 2'
expect_json out 'd["steps"]["refit"] == d["refit"]["seconds"] < d["total_s"]'
expect_json out 'd["refit"]["kept"] and d["checked"]["fidelity"] == d["refit"]["reached"]'
expect_json out 'd["checked"]["worst_camera"]["fidelity"] <= d["checked"]["fidelity"] >= d["checked"]["worst_instant"]["fidelity"]'
expect_json out 'd["refit"]["bytes"] == d["file_bytes"] and d["refit"]["weights_alone"]["fidelity"] < 35.5'
# The errors that are stated are those against the scene.
expect_json out 'd["max_errors"]["seen_opacity"] > 0.01'
coded=$(json out 'd["coded_gaussians"]')
expect 0 encode s.ply --cameras c.json --quality 36 -o again.l4d --threads 3 --refit 2
cmp d.l4d again.l4d
expect_text out 'opacities fitted in 2 passes over'
expect 0 validate d.l4d
# In all views the fidelity is what it was in those of the check, about.
expect_document 0 compare s.ply d.l4d --cameras c.json --split train
expect_json out 'd["fidelity_db"] > 35.5'
# More effort: more passes.
expect_document 0 encode s.ply --cameras c.json --quality 36 --effort 8 -o effort.l4d
expect_json out 'd["refit"]["thresholds"][d["refit"]["chosen"]]["passes"] == 4'
# An order names rows of the input, and --verify compares with it.
expect_document 0 encode s.ply --cameras c.json --quality 36 -o o.l4d --order o.order --verify
expect_json out "d['verify']['matched'] == $coded == d['coded_gaussians'] == 3000 - d['pruned']"
expect_json out 'd["verify"]["attributes"]["opacity"]["max"] > 0.01'

# --refit 0 is what the weights alone give.
expect_document 0 encode s.ply --cameras c.json --quality 36 --refit 0 -o none.l4d --save-weights w.ply
expect_json out '"refit" not in d and d["quality"] == 36'
expect 0 encode s.ply --cameras c.json --weights w.ply --prune-weight 0 --quality 36 -o file.l4d
cmp none.l4d file.l4d
if cmp -s none.l4d d.l4d; then die "the refit does nothing"; fi

# The members of a file are made of what was fitted; a piece of a scene lacks others that show in it.
expect_document 0 encode s.ply --cameras c.json --quality 36 --live -o live.l4d
expect_json out 'd["refit"]["kept"] and d["checked"]["fidelity"] >= 36'
expect_document 0 encode s.ply --cameras c.json --quality 36 --live --refit 0 -o plain.l4d
expect_json out '"refit" not in d'
expect_document 0 compare s.ply live.l4d --cameras c.json --split train
expect_json out 'd["fidelity_db"] > 35.5'
expect_document 0 compare s.ply plain.l4d --cameras c.json --split train
expect_json out 'd["fidelity_db"] < 33'
expect 2 encode s.ply s.ply --cameras c.json --live --refit 2 -o pieces.l4d
# A fit that does not pay leaves members as weights alone make them.
expect_document 0 encode s.ply --cameras c.json --quality 20 --all-views --live -o unpaid.l4d
expect_json out 'not d["refit"]["kept"]'
expect 0 encode s.ply --cameras c.json --quality 20 --all-views --live --refit 0 -o alone.l4d
cmp unpaid.l4d alone.l4d

# Targets of bytes and of fidelity are reached with a fit, as with weights alone, by more fidelity or in fewer bytes.
expect_document 0 encode s.ply --cameras c.json --target-size 15000 -o size.l4d
expect_json out 'd["target"]["met"] and d["file_bytes"] <= 15000 and d["refit"]["kept"] and "trials" not in d["refit"]'
expect_json out 'd["checked"]["fidelity"] > d["refit"]["weights_alone"]["fidelity"] + 1'
expect_json out 'd["quality"] == d["target"]["quality"] and d["steps"]["refit"] > 0'
expect_document 0 encode s.ply --cameras c.json --split train --target-fidelity 38 -o fidelity.l4d
expect_json out 'd["target"]["met"] and 38 <= d["target"]["reached"] < 39 and d["refit"]["kept"]'
expect_json out 'd["file_bytes"] < d["refit"]["weights_alone"]["bytes"]'
# The fit knows nothing of cameras that look from elsewhere: what misses the target there is not kept.
expect_document 0 encode s.ply --cameras c.json --target-fidelity 34 -o elsewhere.l4d
expect_json out 'd["target"]["met"] and d["target"]["reached"] >= 34 and "refit" not in d'
# Errors of single attributes are what a fit changes.
expect_document 0 encode s.ply --cameras c.json --max-error log_scale=0.5 -o error.l4d
expect_json out '"refit" not in d'
# Presets that prune nothing by a quality are as before.
expect_document 0 encode s.ply --cameras c.json --preset lossless -o lossless.l4d
expect_json out '"refit" not in d and d["pruned"] == 0'
expect 2 encode s.ply --cameras c.json --preset lossless --refit 4 -o x.l4d

# Views that are made up or some of all drop nothing unless it is requested, and then only what they show.
expect_document 0 encode s.ply --orbit 4 --size 64x48 --quality 36 -o orbit.l4d
expect_json out 'd["pruned"] == 0 and "refit" not in d'
expect_document 0 encode s.ply --orbit 4 --size 64x48 --quality 36 --refit 1 -o orbit1.l4d
expect_json out 'd["pruned"] > 0 and d["coded_gaussians"] >= d["sensitivity"]["unseen"] > 0'
expect_json out 'd["refit"]["thresholds"][d["refit"]["chosen"]]["passes"] == 1'

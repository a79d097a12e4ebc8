# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# cameras: files of cameras, made up or converted, that --cameras of other verbs takes.
expect 0 synth -n 3k --seconds 1 --cameras-out square.json -o s.ply
expect 0 encode s.ply -o s.l4d

# Made up: around the scene, and as a rig in front of it. The same of a scene and of its stream.
expect_document 0 cameras s.ply --orbit 17 --size 96x64 -o orbit.json
expect_json out 'd["source"] == "orbit" and d["cameras"] == 17 and d["test"] == 3 and d["training"] == 14'
expect_json out "d['file_bytes'] == $(wc -c < orbit.json)"
expect 0 compare s.ply s.l4d --orbit 17 --size 96x64 --frames 15
grep against out > made_up
expect 0 compare s.ply s.l4d --cameras orbit.json --split all --frames 15
grep against out | cmp - made_up
expect_document 0 cameras s.l4d --grid 5x3 --size 96x64 --spread 0.2 -o grid.json
expect_json out 'd["cameras"] == 15 and d["test"] == 1'
expect_json grid.json 'd["frames"] == 30 and d["fps"] == 30 and d["width"] == 96'
expect_json grid.json '[c["id"] for c in d["cameras"] if c["split"] == "test"] == [7]'
# The camera in the middle is that of the first view.
expect 0 render s.l4d --time 0.5 --size 96x64 -o first.png
expect 0 render s.l4d --time 0.5 --cameras grid.json --camera 7 -o middle.png
cmp first.png middle.png
# What stands apart is a fifth of the distance to the target wide.
"$PYTHON" - << 'END'
import json, math
cameras = json.load(open("grid.json"))["cameras"]
def center(c):
    m = c["w2c"]
    return [-sum(m[r][k] * m[r][3] for r in range(3)) for k in range(3)]
eye, target = (-1.5, 2.6, 13.4), (0.3, 3.15, -3.0)
assert math.dist(center(cameras[7]), eye) < 1e-6, center(cameras[7])
assert abs(math.dist(center(cameras[5]), center(cameras[9])) - 0.2 * math.dist(eye, target)) < 1e-6
for c in cameras:  # all look at the target
    view = [sum(c["w2c"][r][k] * target[k] for k in range(3)) + c["w2c"][r][3] for r in range(3)]
    assert max(abs(view[0]), abs(view[1])) < 1e-6, view
END

# From the tool's own form nothing changes, and standard output is one.
expect_document 0 cameras --from square.json -o same.json
expect_json out 'd["source"] == "cameras_json" and d["notes"] == []'
cmp square.json same.json
l4d cameras --from square.json -o - --quiet > stdout.json
cmp square.json stdout.json
# Paths of images stay those of the same files, and other keys stay.
mkdir -p there/images
cat > there/own.json << 'END'
{"fps": 25, "cameras": [{"id": 3, "width": 40, "height": 30, "K": [[30, 0, 20], [0, 31, 15], [0, 0, 1]],
 "w2c": [[1, 0, 0, 0.5], [0, 1, 0, 0], [0, 0, 1, 2], [0, 0, 0, 1]], "images": "images/%04d.png", "near": 0.5,
 "mask": "mask.png", "time_offset": 0.25, "distortion": [0.1, 0, 0, 0, 0.2]},
 {"id": 1, "width": 41, "height": 30, "K": [[30, 0, 20], [0, 31, 15], [0, 0, 1]],
 "w2c": [[1, 0, 0, 0.5], [0, 1, 0, 0], [0, 0, 1, 2], [0, 0, 0, 1]], "distortion_model": "fisheye",
 "distortion": [0.1, 0.2]}]}
END
expect 0 cameras --from there/own.json -o moved.json
expect_json moved.json '(c := d["cameras"][0])["images"] == "there/images/%04d.png" and c["mask"] == "there/mask.png"'
expect_json moved.json '(c := d["cameras"][0])["near"] == 0.5 and c["time_offset"] == 0.25 and c["width"] == 40'
expect_json moved.json 'd["cameras"][0]["distortion"] == [0.1, 0, 0, 0, 0.2, 0, 0, 0] and "split" not in d["cameras"][0]'
expect_json moved.json 'd["cameras"][1]["distortion_model"] == "fisheye" and "frames" not in d'

# COLMAP: a folder of a model, or the one above.
mkdir -p colmap/sparse/0
cat > colmap/sparse/0/cameras.txt << 'END'
# comment
1 PINHOLE 40 30 30 31 20 15
END
cat > colmap/sparse/0/images.txt << 'END'
9 1 0 0 0 0.5 0 2 1 b.jpg

4 0 0 1 0 0.25 0 1 1 a.jpg

END
for folder in colmap colmap/sparse/0; do
  expect_document 0 cameras --from $folder -o c.json --force
  expect_json out 'd["source"] == "colmap" and d["cameras"] == 2 and "a.jpg" in d["notes"][0]'
done
expect_json c.json '[c["w2c"][0][3] for c in d["cameras"]] == [0.25, 0.5] and d["cameras"][0]["w2c"][0][0] == -1'
expect 0 render s.l4d --cameras colmap --camera 1 --time 0.5 -o colmap.png
expect 5 cameras --from there -o d.json
expect_text err 'a model of COLMAP has cameras and images'

# Numbers that are none are refused by the name of what has them.
# The folder is named, and no file of its model is replaced.
cp -r colmap/sparse/0 model
expect 2 cameras --from colmap -f -o colmap/sparse/0/images.txt
expect 2 cameras --from colmap/sparse/0 -f -o colmap/sparse/0/cameras.txt
diff -r colmap/sparse/0 model || die 'a file of the cameras was replaced'
sed 's/0.25/nan/' colmap/sparse/0/images.txt > nan.txt && mv nan.txt colmap/sparse/0/images.txt
expect 4 cameras --from colmap -o d.json
expect_text err 'image a.jpg: .*not finite|image a.jpg: .*translation'

# Transforms, whose instants have no key; the path of a viewer.
cat > transforms.json << 'END'
{"w": 40, "h": 30, "fl_x": 30, "frames": [{"time": 0.5, "file_path": "x", "transform_matrix":
 [[1, 0, 0, 1], [0, 1, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]]}]}
END
expect_document 0 cameras --from transforms.json -o t.json
expect_json out 'len(d["notes"]) == 2 and "instant" in d["notes"][0] and "image" in d["notes"][1]'
expect_json t.json 'd["cameras"][0]["w2c"] == [[1, 0, 0, -1], [0, -1, 0, 2], [0, 0, -1, 3], [0, 0, 0, 1]]'
cat > path.json << 'END'
{"camera_type": "perspective", "render_width": 40, "render_height": 30, "fps": 24, "seconds": 4, "camera_path":
 [{"camera_to_world": [1, 0, 0, 1, 0, 1, 0, 2, 0, 0, 1, 3, 0, 0, 0, 1], "fov": 90, "aspect": 1.3}]}
END
expect_document 0 cameras --from path.json -o p.json
expect_json out 'd["source"] == "camera_path"'
expect_json p.json 'abs(d["cameras"][0]["K"][0][0] - 15) < 1e-9 and d["fps"] == 24'
"$PYTHON" -c 'import json; p, t = (json.load(open(f))["cameras"][0]["w2c"] for f in ("p.json", "t.json")); assert p == t'
for wrong in 's/"perspective"/"equirectangular"/ 5' 's/"fov": 90/"fov": 190/ 4' 's/\[1, 0, 0, 1, /[/ 4' 's/: 30, "fps"/: 0, "fps"/ 4'; do
  sed "${wrong% *}" path.json > wrong.json
  expect "${wrong##* }" cameras --from wrong.json -o w.json
done

# Careless hands.
expect 2 cameras s.ply --orbit 3 --spread 2 -o x.json
expect 2 cameras -o x.json
expect 2 cameras s.ply -o x.json
expect 2 cameras --orbit 3 -o x.json
expect 2 cameras s.ply --from square.json -o x.json
expect 2 cameras s.ply --orbit 3 --grid 2x2 -o x.json
expect 2 cameras s.ply --grid 5 -o x.json
expect 2 cameras s.ply --grid 0x3 -o x.json
expect 2 cameras s.ply --grid 2x2 --spread 0 -o x.json
expect 2 cameras --from square.json --size 10x10 -o x.json
expect 2 cameras s.ply --orbit 3 -o x.ply
expect 3 cameras --from none.json -o x.json
expect 3 cameras s.ply --orbit 3 -o square.json
expect 2 cameras --from square.json -o square.json --force
expect_missing x.json w.json d.json

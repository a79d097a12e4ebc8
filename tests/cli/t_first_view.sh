# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# Each stream states a first view, and pictures are taken from there.
make_scene s.ply 4000
make_cameras c.json 30

# view FILE NAME: what info says of the first view, into NAME.
view() {
  expect_document 0 info "$1"
  "$PYTHON" -c 'import json, sys; print(json.load(open("out"))["presentation"]["camera"])' > "$2"
}
expect 0 encode s.ply -o plain.l4d -q
view plain.l4d plain.view
grep -q position plain.view || die "no first view: $(cat plain.view)"
expect 0 encode s.ply -o none.l4d -q --no-first-view
view none.l4d none.view
expect_equal "$(cat none.view)" None
expect 0 encode s.ply -o cameras.l4d -q --cameras c.json --frames 0:60:20
view cameras.l4d cameras.view
# One of the training cameras of make_cameras, 1 or 3, looking at the middle.
"$PYTHON" - << 'END' || die "not a training camera: $(cat cameras.view)"
import ast, json
view = ast.literal_eval(open("cameras.view").read())
eyes = []
for c in json.load(open("c.json"))["cameras"]:
    m = c["w2c"]
    eye = [-sum(m[r][k] * m[r][3] for r in range(3)) for k in range(3)]
    if c["split"] == "train" and max(abs(a - b) for a, b in zip(eye, view["position"])) < 1e-9: eyes.append(c["id"])
assert len(eyes) == 1, eyes
END
# What is stated stays, through streams and PLY, whatever the cameras.
expect 0 encode s.ply -o mine.l4d -q --presentation camera=0:1:5:0:0:0:0:1:0:50
expect 0 decode mine.l4d -o mine.ply
expect 0 encode mine.ply -o again.l4d -q --cameras c.json --frames 0
view mine.l4d mine.view
view again.l4d again.view
cmp mine.view again.view || die "another first view"
# Pieces of a session have the view of the first.
expect 0 encode --live s.ply --segment 0.5 -o live.l4d -q
view live.l4d live.view
cmp live.view plain.view || die "a session has another view: $(cat live.view)"

# A picture without a word about cameras is of the first view; --camera asks for one that is made up.
expect 0 render mine.l4d --time 1 -o mine.png
expect 0 render plain.l4d --time 1 -o plain.png
expect 0 render plain.l4d --time 1 --camera 0 -o made.png
expect 0 render none.l4d --time 1 -o none.png
cmp -s mine.png plain.png && die "the first view is not obeyed"
cmp -s plain.png made.png && die "--camera is not obeyed"
expect_text err 'The scene states no first view: this one is made up'
expect_png mine.png 640 360
expect_document 0 render mine.l4d --time 1 --size 100x80 -o sized.png
expect_json out 'd["camera"] is None and d["width"] == 100'

# To swing is to go to both sides of it and back: the first frame and the middle one are the same view.
expect 0 render mine.l4d --from 1 --to 1.12 --fps 30 --swing 20 --size 64x48 -o s%d.png
for k in 0 1 2 3; do
  expect 0 render mine.l4d --time "$("$PYTHON" -c "print(1 + $k / 30)")" --size 64x48 -o t$k.png
done
cmp s0.png t0.png || die "a swing begins elsewhere"
cmp s2.png t2.png || die "a swing is not back in the middle"
for k in 1 3; do
  if cmp -s s$k.png t$k.png; then die "--swing does nothing"; fi
done
expect 2 render mine.l4d --time 1 --swing 20 -o x.png
expect 2 render mine.l4d --swing 91 -o x%d.png
expect 2 render none.l4d --camera 0 --swing 20 -o x%d.png
expect_text err 'excludes'

# An orbit is around what is stated: the same one, whatever stands outside.
expect 0 encode s.ply -o bounds.l4d -q --presentation bounds=-1:-1:-1:1:1:1
expect 0 encode s.ply -o wide.l4d -q --presentation bounds=-4:-4:-4:4:4:4
for name in bounds wide; do
  expect 0 render $name.l4d --time 1 --camera 0 -o $name.png
done
for other in wide.png made.png; do
  if cmp -s bounds.png $other; then die "bounds are not obeyed"; fi
done

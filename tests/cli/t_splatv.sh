# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# .splatv files, packed here by Python's struct: every verb takes them as it takes the PLY of the
# same SpacetimeGaussians lite model.
"$PYTHON" - <<'PY'
import json, math, struct
# position, rotation, scale, colour, opacity (of 255), motion, turning, centre, width
rows = [([i % 7, i // 7, 2.5], (1, 0.5, 0, 0.25), (0.25, 0.5, 0.125), (51, 102, 153), 204,
         [0.5, 0, -1] + [0.25 * (i % 2)] * 6, (0, 0.125 * (i % 2), 0, 0), i / 64, 0.25) for i in range(40)]
texture = b"".join(
    struct.pack("<3f8e4B16e", *p, *q, *s, 0, *c, a, *m, 0, *w, t, width)
    for p, q, s, c, a, m, w, t, width in rows).ljust(4096 * 16, b"\0")
eye = {"id": 0, "position": [3, 3, -9], "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
       "fx": 300, "fy": 300, "width": 400, "height": 300}
text = json.dumps([{"type": "splat", "size": len(texture), "texwidth": 4096, "texheight": 1, "cameras": [eye]}]).encode()
with open("model.splatv", "wb") as file:
    file.write(struct.pack("<II", 0x674b, len(text)) + text + texture)
names = (["x", "y", "z", "trbf_center", "trbf_scale"] + [f"motion_{k}" for k in range(9)]
         + [f"f_dc_{k}" for k in range(3)] + ["opacity"] + [f"scale_{k}" for k in range(3)]
         + [f"rot_{k}" for k in range(4)] + [f"omega_{k}" for k in range(4)])
with open("model.ply", "wb") as file:
    file.write(f"ply\nformat binary_little_endian 1.0\nelement vertex {len(rows)}\n".encode())
    file.write("".join(f"property float {name}\n" for name in names).encode() + b"end_header\n")
    for p, q, s, c, a, m, w, t, width in rows:
        file.write(struct.pack("<29f", *p, t, math.log(width), *m, *[x / 255 for x in c],
                               math.log(a / (255 - a)), *[math.log(x) for x in s], *q, *w))
PY
cp model.splatv nameless
expect_document 0 encode nameless --seconds 4 --fps 25 --preset lossless -o s.l4d
expect_json out 'd["source"] == "splatv" and d["coded_gaussians"] == 40'
expect_json out 'sum(n.startswith(("20 Gaussians move along curves", "20 Gaussians turn")) for n in d["notes"]) == 2'
expect_document 0 info s.l4d
expect_json out 'd["num_frames"] == 100 and d["presentation"]["camera"]["position"] == [3, 3, -9]'
expect 0 encode model.ply --seconds 4 --fps 25 --preset lossless -o p.l4d
for time in 0 1.3 4; do
  expect 0 slice model.splatv --seconds 4 --time $time -o s.ply -f
  expect 0 slice p.l4d --time $time -o p.ply -f
  "$PYTHON" -B "$ROOT/tests/cli/splats_close.py" s.ply p.ply position=1e-4 covariance=1e-3 color=1e-4 opacity=1e-4 sh=0
done
expect_document 0 convert model.splatv scene.4dgs --seconds 4
expect_document 0 info model.splatv
expect_json out 'd["num_gaussians"] == 40 and any("1 seconds at 30" in n for n in d["notes"])'
expect_document 0 compare model.splatv model.splatv
expect_json out 'd["identical"]'

# One file is no frame of a sequence; and what is cut or no .splatv.
mkdir frames && cp model.splatv frames/a.splatv && cp model.splatv frames/b.splatv
expect 5 encode frames -o x.l4d
expect_text err 'changes over time'
head -c 5000 model.splatv > cut.splatv
expect 4 info cut.splatv
expect_text err 'cut.splatv: the chunk splat has 65536 bytes, and [0-9]* are left'
head -c 100 /dev/zero > zeros.splatv
expect 4 info zeros.splatv
expect_text err 'zeros.splatv: no SPLATV file'
expect 2 convert model.splatv x.splatv
expect 6 encode model.splatv -o x.l4d --limit-memory 50k

# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# render: stills, sequences and videos, of PLY and streams.
make_scene s.ply 3000
make_cameras c.json
expect 0 encode s.ply -o s.l4d --preset lossless

# A still: middle of the sequence, first camera.
expect_document 0 render s.ply --cameras c.json -o a.png
expect_json out 'd["width"] == 96 and d["height"] == 64 and d["frames"] == 1 and d["camera"] == 0'
expect_json out 'd["time_begin"] == 1 and 0 < d["projected"] <= d["visible"] <= 3000'
expect_json out "d['file_bytes'] == $(wc -c < a.png)"
expect_png a.png 96 64
expect 0 render s.ply --cameras c.json --camera 0 --time 1 -o same.png
cmp a.png same.png
expect 0 render s.ply --cameras c.json --camera 1 -o other.png
if cmp -s a.png other.png; then die "--camera does nothing"; fi
expect 0 render s.ply --cameras c.json --time 0 -o other.png --force
if cmp -s a.png other.png; then die "--time does nothing"; fi
expect 3 render s.ply --cameras c.json -o a.png
expect 2 render s.ply --cameras c.json --camera 4 -o x.png
expect 3 render s.ply --cameras missing.json -o x.png
echo '{"cameras": 3}' > bad.json
expect_document 4 render s.ply --cameras bad.json -o x.png
expect_missing x.png
l4d render s.ply --cameras c.json -o - > stdout.png 2> err
cmp a.png stdout.png

# A lossless stream shows the same, threads change nothing, and stdin will do.
expect_document 0 render s.l4d --cameras c.json -o l.png
expect_json out '0 < d["projected"] <= d["visible"] <= 3000'
expect 0 compare s.ply s.l4d --cameras c.json --frames 30 --min-fidelity 60
expect 0 render s.ply --cameras c.json -o t.png --threads 1
cmp a.png t.png
expect 0 render s.ply --cameras c.json -o t.png --threads 3 --force
cmp a.png t.png
l4d render - --cameras c.json -o stdin.png < s.l4d > out
cmp l.png stdin.png

# Both paths agree; what they paint differs from black and from the background.
expect_document 0 render s.ply --cameras c.json --path reference -o r.png
expect_json out 'd["instances"] == 0'
expect 0 render s.ply --cameras c.json --background 0,0.5,1 -o bg.png
"$PYTHON" -c 'import struct, zlib

def pixels(name):
    data, at, packed = open(name, "rb").read(), 8, b""
    while at < len(data):
        size, kind = struct.unpack(">I4s", data[at:at + 8])
        packed += data[at + 8:at + 8 + size] if kind == b"IDAT" else b""
        at += 12 + size
    raw, rows, stride = zlib.decompress(packed), [], 3 * 96
    for y in range(64):
        method, line = raw[y * (stride + 1)], bytearray(raw[y * (stride + 1) + 1:(y + 1) * (stride + 1)])
        up = rows[-1] if rows else bytearray(stride)
        for x in range(stride):
            left, above, corner = (line[x - 3] if x > 2 else 0), up[x], (up[x - 3] if x > 2 else 0)
            near = min((abs(above - corner), 0, left), (abs(left - corner), 1, above),
                       (abs(left + above - 2 * corner), 2, corner))[2]
            line[x] = (line[x] + [0, left, above, (left + above) // 2, near][method]) & 255
        rows.append(line)
    return b"".join(rows)

fast, slow, background = pixels("a.png"), pixels("r.png"), pixels("bg.png")
assert max(abs(x - y) for x, y in zip(fast, slow)) <= 1
assert max(fast) > 100
# Where the scene lets light through the background adds to it: green and blue, never red.
assert fast[0::3] == background[0::3]
assert all(x <= y for x, y in zip(fast, background)) and fast[2::3] != background[2::3]'

# Sizes.
expect_document 0 render s.ply --cameras c.json --scale 0.5 -o half.png
expect_json out 'd["width"] == 48 and d["height"] == 32'
expect_png half.png 48 32
expect_document 0 render s.ply --size 101x67 -o orbit.png
expect_json out 'd["width"] == 101 and any("no first view" in n for n in d["notes"])'
expect_png orbit.png 101 67
expect 0 render s.ply --size 101x67 --camera 3 -o orbit.png --force

# A sequence; its end is no frame of it.
expect_document 0 render s.l4d --cameras c.json --range 0.5:1 --fps 10 -o f_%02d.png
expect_json out 'd["frames"] == 5 and d["frame_rate"] == 10 and d["time_end"] == 0.9'
expect_png f_04.png 96 64
expect_missing f_05.png
expect 0 render s.l4d --cameras c.json --time 0.7 -o at.png
cmp at.png f_02.png
expect_document 0 render s.ply --orbit --size 64x48 --from 1 --fps 4 -o o_%d.png
expect_json out 'd["frames"] == 4 and d["camera"] is None'
if cmp -s o_0.png o_1.png; then die "--orbit does not circle"; fi
expect 3 render s.l4d --cameras c.json --range 0:1 --fps 10 -o f_%02d.png

expect 0 render s.ply --cameras c.json --range 0:1 -o p_%02d.png --progress json
"$PYTHON" -c 'import json
lines = [json.loads(line) for line in open("err")]
assert any(l["verb"] == "render" and l["total"] == 30 for l in lines)'

need_ffmpeg
expect_document 0 render s.l4d --orbit --size 65x47 --range 0:0.5 -o o.mp4
expect_json out 'd["frames"] == 15 and d["width"] == 65'
expect_equal "$(head -c 8 o.mp4 | tail -c 4)" ftyp
# No temporary stays.
expect_equal "$(echo ./*o.mp4* .[!.]*)" "./o.mp4 .[!.]*"

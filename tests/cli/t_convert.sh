# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# One verb from any format to any other: the name of the output decides.
make_scene s.ply 300
expect_document 0 convert s.ply s.l4d --preset lossless
expect_json out 'd["source"] == "l4d_ply" and d["output"] == "s.l4d" and d["num_gaussians"] == 300'
for name in back.ply arrays.safetensors; do
  expect_document 0 convert s.l4d $name
  expect 0 convert $name again.l4d --preset lossless --force
  expect_document 0 compare s.l4d again.l4d
  expect_json out 'd["identical"]'
done
expect 2 convert back.ply ./back.ply --force
expect_text err 'the input and the output are the same file'
# Rows keep their order, and all their bits.
expect 0 convert s.ply rows.safetensors
expect 0 convert rows.safetensors rows.ply
cmp rows.ply s.ply || die 'raw arrays are not the scene'
expect 0 info rows.safetensors
expect_text err 'a lossless encoding of the scene'
expect 0 convert s.l4d s.ftgs.ply
expect_text s.ftgs.ply ftgs_version
# The same, with t, scale_t and motion.
expect_document 0 convert s.l4d s.stg.ply
expect_json out 'any("how long" in n for n in d["notes"])'
expect_document 0 info s.stg.ply --seconds 2
expect_json out 'd["source"] == "stg_ply" and d["num_gaussians"] == 300'
for time in 0.3 1.5; do
  expect 0 slice s.l4d --time $time -o a.ply --force
  expect 0 slice s.stg.ply --seconds 2 --time $time -o b.ply --force
  "$PYTHON" "$ROOT/tests/cli/splats_close.py" a.ply b.ply position=2e-5 covariance=1e-3 color=1e-6 opacity=1e-4 sh=0
done
expect 0 convert s.l4d moment.ply --time 1
expect 0 slice s.l4d --time 1 -o slice.ply
cmp moment.ply slice.ply

# Codes of 8 to 11 bits in ranges of 256 Gaussians.
expect_document 0 convert s.l4d moment.compressed.ply --time 1
expect_json out 'any("one instant" in n for n in d["notes"])'
expect_document 0 convert moment.compressed.ply packed.ply
expect_json out 'd["source"] == "compressed_ply"'
"$PYTHON" "$ROOT/tests/cli/splats_close.py" moment.ply packed.ply position=0.02 covariance=0.05 color=0.02 opacity=0.003 sh=0.05
expect 0 slice s.l4d --time 1 -o slice.compressed.ply
cmp moment.compressed.ply slice.compressed.ply

# A static scene stays one that other tools read.
expect_document 0 convert moment.ply static.ply
expect_json out 'd["source"] == "3dgs_ply" and any("one instant" in n for n in d["notes"])'
grep -aq 'property float rot_3' static.ply || die 'no 3DGS PLY'
expect 0 convert s.ply Q.PLY --time 1

# Frames become one scene.
mkdir frames
expect 0 slice s.l4d --from 0 --to 0.5 --fps 30 -o frames/f_%d.ply
expect 0 convert frames/f_%d.ply clip.l4d --fps 30 --preset lossless
expect 0 encode frames --fps 30 -o encoded.l4d --preset lossless
cmp clip.l4d encoded.l4d

# glTF: structure, and the values of the PLY of the same instant.
expect_document 0 convert s.l4d moment.glb --time 1
expect_json out 'any("one instant" in n for n in d["notes"])'
expect_document 0 convert moment.ply unknown.glb
expect_json out 'any("axes" in n for n in d["notes"])'
cat > check.py <<'PY'
import json, math, struct, sys
data = open(sys.argv[1], "rb").read()
magic, version, total, length, kind = struct.unpack_from("<4sIII4s", data)
assert (magic, version, total, kind) == (b"glTF", 2, len(data), b"JSON")
assert length % 4 == 0
doc = json.loads(data[20:20 + length])
size, kind = struct.unpack_from("<I4s", data, 20 + length)
assert kind == b"BIN\0" and size == doc["buffers"][0]["byteLength"] == len(data) - 28 - length
body = data[28 + length:]
assert doc["asset"]["version"] == "2.0" and doc["extensionsUsed"] == ["KHR_gaussian_splatting"]
primitive = doc["meshes"][doc["nodes"][doc["scenes"][doc["scene"]]["nodes"][0]]["mesh"]]["primitives"][0]
assert primitive["mode"] == 0
assert primitive["extensions"] == {"KHR_gaussian_splatting": {
    "kernel": "ellipse", "colorSpace": "srgb_rec709_display"}}
width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}
columns = {}
for name, index in primitive["attributes"].items():
    a = doc["accessors"][index]
    view = doc["bufferViews"][a["bufferView"]]
    n = width[a["type"]]
    assert a["componentType"] == 5126 and view["byteLength"] == 4 * n * a["count"]
    assert view["byteOffset"] % 4 == 0 and view["byteOffset"] + view["byteLength"] <= size
    values = struct.unpack_from("<%df" % (n * a["count"]), body, view["byteOffset"])
    columns[name] = [values[i:i + n] for i in range(0, len(values), n)]
    if name == "POSITION":
        for k in range(3):
            assert a["min"][k] == min(v[k] for v in columns[name])
            assert a["max"][k] == max(v[k] for v in columns[name])
ply = open(sys.argv[2], "rb").read()
end = ply.index(b"end_header\n") + 11
names = [l.split()[-1] for l in ply[:end].decode().splitlines() if l.startswith("property")]
rows = [dict(zip(names, struct.unpack_from("<%df" % len(names), ply, i)))
        for i in range(end, len(ply), 4 * len(names))]
k = "KHR_gaussian_splatting:"
assert len(rows) == len(columns["POSITION"]) > 100
near = lambda a, b: abs(a - b) <= 2e-6 * max(1, abs(b))
for i, row in enumerate(rows):
    assert columns["POSITION"][i] == (row["x"], row["y"], row["z"])
    assert all(near(columns[k + "SCALE"][i][c], math.exp(row["scale_%d" % c])) for c in range(3))
    assert columns[k + "ROTATION"][i] == (row["rot_1"], row["rot_2"], row["rot_3"], row["rot_0"])
    o = 1 / (1 + math.exp(-row["opacity"]))
    assert near(columns[k + "OPACITY"][i][0], o)
    assert columns[k + "SH_DEGREE_0_COEF_0"][i] == tuple(row["f_dc_%d" % c] for c in range(3))
    for c in range(3):
        assert columns[k + "SH_DEGREE_1_COEF_0"][i][c] == row["f_rest_%d" % (15 * c)]
        assert columns[k + "SH_DEGREE_3_COEF_6"][i][c] == row["f_rest_%d" % (15 * c + 14)]
        s = min(max(0.5 + 0.28209479177387814 * row["f_dc_%d" % c], 0), 1)
        linear = s / 12.92 if s <= 0.04045 else ((s + 0.055) / 1.055) ** 2.4
        assert near(columns["COLOR_0"][i][c], linear)
    assert near(columns["COLOR_0"][i][3], o)
PY
"$PYTHON" check.py moment.glb moment.ply
expect 0 convert moment.glb again.ply
"$PYTHON" "$ROOT/tests/cli/splats_close.py" moment.ply again.ply position=0 covariance=1e-5 color=0 opacity=1e-6 sh=0
# Axes, origin and scale of the placement go into the node.
"$PYTHON" - <<'PY'
lines = open("s.ply", "rb").read().split(b"\n")
data = b"\n".join(line for line in lines if not line.startswith(b"comment l4d_coordinates"))
more = b"comment l4d_coordinates right_down_forward\ncomment l4d_origin 10 20 30\ncomment l4d_scale 2\n"
open("placed.ply", "wb").write(data.replace(b"comment fps", more + b"comment fps", 1))
PY
expect_document 0 convert placed.ply placed.glb --time 1
expect_json out 'not any("axes" in n for n in d["notes"])'
"$PYTHON" - <<'PY'
import json
data = open("placed.glb", "rb").read()
node = json.loads(data[20:20 + int.from_bytes(data[12:16], "little")])["nodes"][0]
assert node == {"mesh": 0, "rotation": [1, 0, 0, 0], "scale": [2, 2, 2], "translation": [10, -20, -30]}, node
PY
expect_document 0 info placed.glb
expect_json out 'd["placement"]["origin"] == [10, 20, 30] and d["placement"]["scale"] == 2'

# USD: the numbers of the PLY of the same instant, and the placement as a transform.
expect_document 0 convert s.l4d moment.usda --time 1
expect_json out 'any("one instant" in n for n in d["notes"])'
expect 0 slice s.l4d --time 1 -o slice.usda
cmp moment.usda slice.usda
expect_document 0 convert placed.ply placed.usda --time 1
cat > check_usd.py <<'PY'
import math, re, struct, sys
text = open(sys.argv[1]).read()
assert text.startswith('#usda 1.0\n(\n    defaultPrim = "Splats"\n    metersPerUnit = 1\n    upAxis = "Y"\n)\n')
assert text.count("{") == text.count("}") == 1 and text.count("[") == text.count("]")
assert 'def ParticleField3DGaussianSplat "Splats"\n{' in text
def array(declared, numbers):
    body = re.search(r"^    " + re.escape(declared) + r" = \[(.*?)\]", text, re.M).group(1)
    values = [float(x) for x in re.findall(r"-?[0-9][0-9.e+-]*", body)]
    return [values[i:i + numbers] for i in range(0, len(values), numbers)]
ply = open(sys.argv[2], "rb").read()
end = ply.index(b"end_header\n") + 11
names = [l.split()[-1] for l in ply[:end].decode().splitlines() if l.startswith("property")]
rows = [dict(zip(names, struct.unpack_from("<%df" % len(names), ply, i)))
        for i in range(end, len(ply), 4 * len(names))]
f32 = lambda x: struct.unpack("<f", struct.pack("<f", x))[0]
near = lambda a, b: abs(a - b) <= 2e-6 * max(1, abs(b))
positions, scales = array("point3f[] positions", 3), array("float3[] scales", 3)
turns, opacities = array("quatf[] orientations", 4), array("float[] opacities", 1)
sh, colors = array("float3[] radiance:sphericalHarmonicsCoefficients", 3), array("color3f[] primvars:displayColor", 3)
low, high = array("float3[] extent", 3)
assert len(rows) == len(positions) == len(scales) == len(turns) == len(opacities) == len(colors) > 100
assert len(sh) == 16 * len(rows) and "uniform int radiance:sphericalHarmonicsDegree = 3\n" in text
for i, row in enumerate(rows):
    assert [f32(x) for x in positions[i]] == [row["x"], row["y"], row["z"]]
    assert [f32(x) for x in turns[i]] == [row["rot_%d" % k] for k in range(4)]
    assert all(near(scales[i][k], math.exp(row["scale_%d" % k])) for k in range(3))
    assert near(opacities[i][0], 1 / (1 + math.exp(-row["opacity"])))
    assert [f32(x) for x in sh[16 * i]] == [row["f_dc_%d" % k] for k in range(3)]
    assert [f32(x) for x in sh[16 * i + 15]] == [row["f_rest_%d" % (15 * k + 14)] for k in range(3)]
    assert all(low[k] < positions[i][k] < high[k] for k in range(3))
    assert all(0 <= x <= 1 for x in colors[i])
PY
"$PYTHON" check_usd.py moment.usda moment.ply
expect_text placed.usda '^    double3 xformOp:translate = .10, -20, -30.$'
expect_text placed.usda '^    float xformOp:rotateX = 180$'
expect_text placed.usda '^    float3 xformOp:scale = .2, 2, 2.$'
expect_text placed.usda 'xformOpOrder = ."xformOp:translate", "xformOp:rotateX", "xformOp:scale".'

# .4dgs: the whole scene. The structure, and at an instant the numbers of the PLY of that instant.
expect_document 0 convert s.l4d s.4dgs
expect_json out 'd["source"] == "l4d" and d["output"] == "s.4dgs"'
expect 0 decode s.l4d -o decoded.4dgs
cmp s.4dgs decoded.4dgs
cat > check_4dgs.py <<'PY'
import math, struct, sys, zlib
data, moment, instant = open(sys.argv[1], "rb").read(), open(sys.argv[2], "rb").read(), float(sys.argv[3])
MAGIC = b"\x894DGS1\r\n"
assert data[:8] == data[-8:] == MAGIC

class Fields:
    def __init__(self, content):
        self.content, self.at = content, 0
    def take(self, form):
        values = struct.unpack_from("<" + form, self.content, self.at)
        self.at += struct.calcsize("<" + form)
        return values if len(values) > 1 else values[0]
    def bytes(self, size):
        self.at += size
        assert self.at <= len(self.content)
        return self.content[self.at - size:self.at]
    def text(self):
        return self.bytes(self.take("I")).decode()
    def texts(self):
        block, found = Fields(self.bytes(self.take("I"))), {}
        while block.at < len(block.content):
            key = block.text()
            found[key] = block.text()
        return found

def stream_of(fields):
    attribute, width, mode, codec, channels, count, size = fields.take("BBBBBIQ")
    assert codec == 0 and width in (1, 2, 4)
    raw = zlib.decompress(fields.bytes(size))
    n = channels if mode == 2 else count * channels
    assert len(raw) == n * width
    symbols = [sum(raw[j * n + i] << 8 * j for j in range(width)) for i in range(n)]
    values = [(u >> 1) ^ -(u & 1) for u in symbols]
    if mode == 1:
        for i in range(channels, n):
            values[i] += values[i - channels]
    if mode == 2:
        values *= count
    return attribute, channels, [values[i:i + channels] for i in range(0, len(values), channels)]

records, at = [], 8
while at < len(data) - 8:
    opcode, size = struct.unpack_from("<BQ", data, at)
    records.append((opcode, at, 9 + size, data[at + 9:at + 9 + size]))
    at += 9 + size
assert at == len(data) - 8
opcodes = [r[0] for r in records]
assert opcodes[:3] == [1, 3, 4] and opcodes[-1] == 2 and opcodes[-2] == 12
summary, offsets, crc = struct.unpack("<QQI", records[-1][3])
assert offsets == 0 and crc == zlib.crc32(data[summary:records[-1][1]])
assert {r[0] for r in records if summary <= r[1]} == {8, 12, 2} and 8 not in {r[0] for r in records if r[1] < summary}

head = Fields(records[0][3])
assert head.text() == "" and head.text() == "l4dcodec"
seconds, total, cutoff = head.take("dQd")
assert head.text() == "gaussian-birth"
bounds = head.take("6d")
degree, flags = head.take("BB")
attributes = head.texts()
assert flags & ~2 == 0 and attributes["color_space"] == "srgb-rec709-display" and head.at == len(head.content)
grid = Fields(records[1][3])
assert grid.text() == "uniform-v1"
origin = grid.take("3d")
pos, scale_log, rot, rgb, alpha, motion, time, sigma_log = grid.take("8d")
assert grid.take("B") == 1
declared = grid.texts()
for key, step in dict(pos=pos, scale_rel=scale_log, rgb=rgb, alpha=alpha, motion=motion, time=time, sigma_rel=sigma_log).items():
    assert 2 * float(declared[key]) == step
table = Fields(records[2][3])
windows = [table.take("dd") for _ in range(table.take("I"))]

CHANNELS = [3, 3, 1, 3, 3, 1, 3, 1, 1, 1, 1]
shown, count, by_offset = [], 0, {r[1]: r for r in records}
indexed = 0
for opcode, _, _, content in records:
    if opcode != 8:
        continue
    entry = Fields(content)
    t0, t1, offset, size, number, bands = entry.take("ddQQII")
    indexed += 1
    chunk_record = by_offset[offset]
    assert chunk_record[0] == 5 and chunk_record[2] == size and bands == degree
    chunk = Fields(chunk_record[3])
    assert chunk.take("dd") == (t0, t1) and 0 <= t0 < t1 <= seconds
    chunk.take("I")
    assert chunk.take("I") == number and chunk.text() == ""
    expanded, stored = chunk.take("QQ")
    assert expanded == stored == len(chunk.content) - chunk.at
    streams = {}
    while chunk.at < len(chunk.content):
        attribute, channels, rows = stream_of(chunk)
        assert channels == CHANNELS[attribute] and len(rows) == number
        streams[attribute] = rows
    assert sorted(streams) == list(range(11))
    harmonics = []
    for _ in range(bands):
        band, offset, size = entry.take("BQQ")
        record = by_offset[offset]
        assert record[0] == 7 and record[2] == size and record[3][0] == band
        fields = Fields(record[3][1:])
        attribute, channels, rows = stream_of(fields)
        assert attribute == 7 and channels == 3 * (2 * band + 1) and len(rows) == number
        assert all(0 <= x <= 255 for row in rows for x in row)
        harmonics.append(rows)
    count += number
    for i in range(number):
        get = lambda k: streams[k][i]
        never = get(9)[0] & 1
        lo, hi = windows[get(10)[0]]
        sigma = math.inf if never else math.exp(get(8)[0] * sigma_log)
        half = hi - lo if never else math.sqrt(-2 * math.log(cutoff)) * sigma
        half = min(max(half, 0.02), 2.0)
        v_step = motion * 2.0 ** -min(max(math.ceil(math.log2(half / 0.5)), -4), 2)
        target = time if never else min(time, 0.05 * sigma)
        t_step = time * 2.0 ** min(max(math.floor(math.log2(target / time)), -10), 0)
        mu = get(7)[0] * t_step
        rest = [origin[k] + get(0)[k] * pos for k in range(3)]
        assert all(bounds[k] - 1e-9 <= rest[k] <= bounds[3 + k] + 1e-9 for k in range(3))
        marginal = 1 if never else math.exp(-0.5 * ((instant - mu) / sigma) ** 2)
        visible = lo <= instant < hi and marginal >= cutoff
        assert not visible or t0 <= instant < t1
        if not visible:
            continue
        q, left_out = [], iter(get(3))
        for k in range(4):
            q.append(None if k == get(2)[0] else next(left_out) * rot)
        q[get(2)[0]] = math.sqrt(max(0, 1 - sum(x * x for x in q if x is not None)))
        g, r, b = get(4)[0], get(4)[0] + get(4)[1], get(4)[0] + get(4)[2]
        shown.append(dict(
            center=[rest[k] + get(6)[k] * v_step * (instant - mu) for k in range(3)],
            opacity=get(5)[0] * alpha * marginal, q=q, scale=[math.exp(x * scale_log) for x in get(1)],
            color=[r * rgb, g * rgb, b * rgb],
            first=[-4 + harmonics[0][i][3 * c] * 8 / 255 for c in range(3)] if harmonics else None))
assert count == total and indexed == opcodes.count(5)

def covariance(q, scale):
    x, y, z, w = q
    norm = math.sqrt(x * x + y * y + z * z + w * w)
    x, y, z, w = (a / norm for a in (x, y, z, w))
    m = [[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
         [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
         [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]]
    return [sum(m[i][k] * scale[k] ** 2 * m[j][k] for k in range(3)) for i in range(3) for j in range(3)]

end = moment.index(b"end_header\n") + 11
names = [l.split()[-1] for l in moment[:end].decode().splitlines() if l.startswith("property")]
compared = 0
for at in range(end, len(moment), 4 * len(names)):
    row = dict(zip(names, struct.unpack_from("<%df" % len(names), moment, at)))
    opacity = 1 / (1 + math.exp(-row["opacity"]))
    if opacity < 0.01:
        continue
    center = [row[k] for k in "xyz"]
    near = min(shown, key=lambda g: sum((a - b) ** 2 for a, b in zip(g["center"], center)))
    wanted = covariance([row["rot_%d" % k] for k in (1, 2, 3, 0)], [math.exp(row["scale_%d" % k]) for k in range(3)])
    size = math.sqrt(max(wanted))
    assert all(abs(a - b) < 2 * pos + 1e-3 * size for a, b in zip(near["center"], center)), (near["center"], center, pos)
    assert abs(near["opacity"] - opacity) < 0.02, (near["opacity"], opacity)
    got = covariance(near["q"], near["scale"])
    assert all(abs(a - b) < 0.02 * size * size for a, b in zip(got, wanted)), (got, wanted)
    for k in range(3):
        color = min(max(0.5 + 0.28209479177387814 * row["f_dc_%d" % k], 0), 1)
        assert abs(near["color"][k] - color) <= rgb / 2 + 1e-6
        if near["first"]:
            assert abs(near["first"][k] - row["f_rest_%d" % (k * ((degree + 1) ** 2 - 1))]) <= 4 / 255 + 1e-6
    compared += 1
assert compared > 20, compared
PY
"$PYTHON" check_4dgs.py s.4dgs moment.ply 1
expect_document 0 convert s.4dgs from_4dgs.l4d
expect_json out 'd["source"] == "4dgs"'
expect 0 convert from_4dgs.l4d again.4dgs
expect 0 info s.4dgs

# SPZ, and a file for each frame.
expect_document 0 convert s.l4d moment.spz --time 1
expect 0 slice s.l4d --time 1 -o slice.spz
cmp moment.spz slice.spz
expect_document 0 convert moment.spz back.spz
expect_json out 'd["source"] == "spz"'
expect_document 0 convert s.l4d f_%02d.spz
expect_json out 'sum("one instant" in n for n in d["notes"]) == 1 and d["output"] == "f_%02d.spz"'
"$PYTHON" -c 'import glob; assert len(glob.glob("f_??.spz")) == 60, glob.glob("f_*")'
expect 0 slice s.l4d --time 0.5 -o half.spz
cmp half.spz f_15.spz
expect 0 slice s.l4d --time 1 -o slice.glb
cmp moment.glb slice.glb
expect 0 slice s.l4d --from 0 --to 0.1 --fps 30 -o g_%d.spz
cmp g_2.spz f_02.spz
expect 0 convert f_%02d.spz frames.l4d --fps 30
expect 0 convert s.l4d h_%d.ply
expect 0 slice s.l4d --time 0 -o zero.ply
cmp zero.ply h_0.ply

# Careless hands.
expect 2 convert s.l4d x.glb
expect_text err "shows one instant: --time"
expect 2 convert s.l4d x.spz
expect_text err 'shows one instant: --time'
expect 2 convert s.l4d x.splat
expect_text err '.safetensors, .compressed.ply, .spz, .sog, .glb or .usda'
expect 2 convert s.l4d x.compressed.ply
expect_text err 'shows one instant: --time'
expect 2 convert s.l4d x_%d.l4d
expect_text err 'frames are .ply, .compressed.ply, .spz, .sog, .glb or .usda'
expect 2 convert s.l4d x_%d.spz --time 1
expect 2 convert s.l4d x
expect 2 convert s.l4d x.l4d --time 1
expect 2 convert s.l4d x.ply --match order
expect 2 convert s.l4d s.l4d --force
expect 3 convert s.l4d moment.glb --time 1
expect 3 convert absent.ply x.l4d
expect 6 convert s.ply x.l4d --limit-memory 10k
expect_missing x.glb x.l4d x.ply x.spz x_0.spz

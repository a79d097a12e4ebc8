# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# What streams state of single Gaussians, against what compare finds, on scenes that are hard.

# Needles, sizes from 1e-4 to 10, fast ones and brief ones, means outside, in any direction.
"$PYTHON" - << 'EOF'
import math, random, struct
random.seed(5)
NAMES = ["x", "y", "z", "t"] + [f"scale_{i}" for i in range(4)] + [f"rotor_{i}" for i in range(8)] + \
        ["opacity", "f_dc_0", "f_dc_1", "f_dc_2"]
def write(path, rows, seconds, begin=0):
    head = ["ply", "format binary_little_endian 1.0", "comment l4d_ply 1",
            "comment time_unit seconds", f"comment time_begin {begin}",
            f"comment time_end {begin + seconds}", "comment fps 30", f"element vertex {len(rows)}",
            *(f"property {'double' if n == 't' else 'float'} {n}" for n in NAMES), "end_header", ""]
    with open(path, "wb") as out:
        out.write("\n".join(head).encode())
        for row in rows:
            out.write(struct.pack("<3fd16f", *row))
def rotor(tilt):
    half = lambda: [random.gauss(0, 1) for _ in range(4)]
    unit = lambda v: [x / math.sqrt(sum(y * y for y in v)) for x in v]
    a = unit(half())
    b = unit([x + tilt * y for x, y in zip(a, half())])
    # s b01 b02 b12 b03 b13 b23 p of halves (s+p, b01-b23, b02+b13, b12-b03), (s-p, b01+b23, ..)
    plus = [(x + y) / 2 for x, y in zip(a, b)]
    minus = [(x - y) / 2 for x, y in zip(a, b)]
    return [plus[0], plus[1], plus[2], plus[3], -minus[3], minus[2], -minus[1], minus[0]]
def rows(n, seconds, begin, tilt, low, high, sigma):
    out = []
    for _ in range(n):
        scales = [random.uniform(math.log(low), math.log(high)) for _ in range(3)]
        scales.append(math.log(random.uniform(*sigma)))
        out.append([*(random.uniform(-3, 3) for _ in range(3)),
                    begin + random.uniform(-0.5, 1.5) * seconds, *scales, *rotor(tilt()),
                    random.gauss(0, 2), *(random.gauss(0, 1) for _ in range(3))])
    return out
write("sizes.ply", rows(1500, 10, 0, lambda: 10 ** random.uniform(-5, 0), 1e-4, 10, (0.02, 40)), 10)
write("needles.ply", rows(1500, 5, 0, lambda: 0.01, 1e-3, 0.5, (0.5, 8)), 5)
# Most are left out: sizes are of what stays.
invalid = rows(4000, 10, 0, lambda: 0.01, 1e-3, 0.1, (0.5, 8))
for row in invalid:
    row[:3] = [0.01 * x for x in row[:3]]
    row[16] = math.nan  # opacity
write("partly.ply", rows(1500, 10, 0, lambda: 0.01, 1e-4, 1e-3, (0.5, 8)) + invalid, 10)
write("brief.ply", rows(1500, 3600, 5e5, lambda: 0.001, 0.01, 0.1, (0.03, 0.1)), 3600, 500000)
EOF

# check IN OUT [COMPARE ARGUMENTS]: no error that compare finds is beyond what info tells, and what
# it tells is hardly more.
check() {
  local in=$1 out=$2
  shift 2
  expect_document 0 info "$out"
  cp out info.json
  expect_document 0 compare "$in" "$out" --order s.order "$@"
  "$PYTHON" - "$in $out" << 'EOF'
import json, os, sys
stated = json.load(open("info.json"))["stated_errors"]
seen = json.load(open("out"))
found = {k: v["max"] for k, v in seen["seen"].items() if k != "min_size"}
found["visible_position"] = seen["visible_position"]["max"]
for name, bound in stated["bounds"].items():
    # What is found is kept as float32.
    slack = 1 + 2.0 ** -23
    assert found[name] <= stated[name] * slack, (sys.argv[1], name, found[name], stated[name])
    assert stated[name] <= 1.1 * found[name] + 1e-4, (sys.argv[1], name, found[name], stated[name])
    assert bound == 0 or stated[name] <= bound * 1.0001, (sys.argv[1], name, stated[name], bound)
assert abs(stated["min_size"] / seen["seen"]["min_size"] - 1) < 1e-6
EOF
}

for scene in sizes needles brief; do
  for preset in tiny default archive; do
    expect 0 encode $scene.ply -o s.l4d --preset $preset --order s.order -f
    check $scene.ply s.l4d
  done
done
expect 0 encode partly.ply -o s.l4d --order s.order --drop-invalid -f
check partly.ply s.l4d
expect 0 encode brief.ply -o s.l4d --preset archive --order s.order -f
expect 0 info s.l4d --json
cp out info.json
expect_json info.json '0 < d["stated_errors"]["mean_t_sigmas"] <= 0.0101'
expect_json info.json 'd["stated_errors"]["bounds"] == {"position_sizes": d["stated_errors"]["bounds"]["position_sizes"], "covariance_factor": d["stated_errors"]["bounds"]["covariance_factor"], "seen_opacity": d["stated_errors"]["bounds"]["seen_opacity"], "visible_position": 0, "base_color": d["stated_errors"]["bounds"]["base_color"], "directional_color": d["stated_errors"]["bounds"]["directional_color"]}'
expect_json info.json 'abs(d["stated_errors"]["bounds"]["base_color"] - 1 / 255) < 1e-6'
expect 0 info s.l4d
expect_text out '^errors of single Gaussians at most, as the encoder states them$'
expect_text out '^  position +0\.[0-9]+ of its size \(bound 0\.1\); sizes below [0-9.e-]+ count as that$'
expect_text out '^  mean time +0\.[0-9]+ of its standard deviation$'
expect_text out '^  base colour +0\.[0-9]+ \(bound 0\.00392\)$'
expect_text out '^  directional colour 0(\.[0-9]+)? in any direction \(bound 0\.[0-9]+\)$'

# Without bounds errors are stated all the same; codebooks state theirs.
expect 0 encode needles.ply -o s.l4d --order s.order -f --set max-position-error=0 \
  --set max-covariance-factor=0 --set max-opacity-error=0 --set max-base-color-error=0 \
  --set max-directional-color-error=0
check needles.ply s.l4d
expect_json info.json 'set(d["stated_errors"]["bounds"].values()) == {0} and d["stated_errors"]["position_sizes"] > 0'
expect 0 encode needles.ply -o s.l4d --preset indexed --order s.order -f
check needles.ply s.l4d

# What is exact is stated to be.
expect 0 encode sizes.ply -o s.l4d --preset lossless -f
expect_document 0 info s.l4d
expect_json out '[d["stated_errors"][k] for k in ("position_sizes", "covariance_factor", "seen_opacity", "visible_position", "mean_t_sigmas", "base_color", "directional_color")] == [0, 1, 0, 0, 0, 0, 0]'
expect 0 info s.l4d
expect_text out '^errors of single Gaussians: none in place, shape, time, opacity and colour$'
expect_document 0 info sizes.ply
expect_json out 'd["stated_errors"] is None'

# Cameras say how small is too small to see: fewer bytes, and larger errors in units of own sizes.
"$PYTHON" -c 'import json
K = [[60, 0, 32], [0, 60, 24], [0, 0, 1]]
cameras = [{"id": i, "split": "train", "video": "", "K": K,
            "w2c": [[1, 0, 0, x], [0, 1, 0, 0], [0, 0, 1, 8], [0, 0, 0, 1]]} for i, x in enumerate((-1, 1))]
json.dump({"fps": 30, "width": 64, "height": 48, "frames": 150, "cameras": cameras}, open("cameras.json", "w"))'
expect 0 encode needles.ply -o far.l4d --order s.order -f --cameras cameras.json \
  --save-weights w.ply --no-prune
check needles.ply far.l4d --cameras cameras.json --frames 0
expect_json info.json 'd["stated_errors"]["own_min_sizes"]'
expect 0 encode needles.ply -o near.l4d --weights w.ply --no-prune
expect_document 0 info near.l4d
expect_json out 'not d["stated_errors"]["own_min_sizes"]'
[ "$(wc -c < far.l4d)" -lt "$(wc -c < near.l4d)" ] || die "least sizes save nothing"

# A stream that counts larger sizes than the scene asks for makes errors in sizes look small, and compare says so.
expect 0 synth --scene cloud -n 2k --seconds 2 --seed 1 -o room.ply
expect 0 synth -n 2k --seconds 2 -o place.ply
expect 0 encode place.ply -o place.l4d --order place.order
"$PYTHON" -c 'import struct; open("as_given.order", "wb").write(struct.pack("<2000I", *range(2000)))'
expect_document 0 compare place.ply place.l4d --order place.order
expect_json out 'd["notes"] == []'
expect_document 0 compare room.ply place.l4d --order as_given.order
expect_json out 'any("place.l4d counts sizes below" in n and "times what A asks for" in n for n in d["notes"])'

# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# Importance weights, pruning, and input that cannot be coded.
make_scene s.ply 3000
"$PYTHON" -c 'import struct
header = ("ply\nformat binary_little_endian 1.0\ncomment l4d_weights 1\nelement vertex 3000\n"
          "property float alpha_t\nproperty float weight_sh_gradient\nproperty float weight_scale\n"
          "property float weight_rotor_spatial\nproperty float weight_rotor_temporal\nend_header\n")
with open("w.ply", "wb") as f:
    f.write(header.encode())
    for i in range(3000):
        alpha = 0.0 if i < 100 else 1e-6 * i
        f.write(struct.pack("<5f", alpha, 0.0, alpha, alpha, alpha))'
expect_document 0 encode s.ply -o pruned.l4d --weights w.ply --prune-weight 0 \
  --order pruned.order --verify
expect_json out 'd["pruned"] == 100 and d["coded_gaussians"] == 2900 == d["verify"]["matched"]'
expect_json out 'd["verify"]["unmatched_a"] == 100 and d["verify"]["unmatched_b"] == 0'
# The order names none of those left out.
"$PYTHON" -c 'import struct
data = open("pruned.order", "rb").read()
order = struct.unpack("<%dI" % (len(data) // 4), data)
assert sorted(order) == list(range(100, 3000))'
expect 0 encode s.ply -o pruned.l4d --weights w.ply --prune-weight 0 --force
expect_text out 'left out 100 of 3,000: 0 invalid, 100 pruned'

# What they measure comes from the file, sum where it does not say so, and matters.
for metric in sum gauss-newton other; do
  "$PYTHON" -c 'import sys
data = open("w.ply", "rb").read()
comment = b"comment l4d_weights 1\n"
more = b"comment metric " + sys.argv[1].encode() + b"\n"
open("w-" + sys.argv[1] + ".ply", "wb").write(data.replace(comment, comment + more))' $metric
done
for name in w w-sum w-gauss-newton; do
  expect 0 encode s.ply -o $name.l4d --weights $name.ply
done
cmp w.l4d w-sum.l4d
if cmp -s w.l4d w-gauss-newton.l4d; then die "the measure does nothing"; fi
expect_document 5 encode s.ply -o x.l4d --weights w-other.ply
expect_json out 'd["error"]["name"] == "L4D_ERR_FEATURE_UNSUPPORTED"'

# Weights must fit the scene and be weights.
make_scene other.ply 2000
expect_document 4 encode other.ply -o x.l4d --weights w.ply
expect_document 3 encode s.ply -o x.l4d --weights missing.ply
# A scene is no weights file.
status=0
l4d encode s.ply -o x.l4d --weights s.ply 2> err || status=$?
case $status in 4 | 5) ;; *) die "a scene as weights: exit status $status" ;; esac
expect_missing x.l4d

# NaN in the first coordinate of the first row.
"$PYTHON" -c 'import struct
data = bytearray(open("s.ply", "rb").read())
at = data.index(b"end_header\n") + 11
data[at:at + 4] = struct.pack("<f", float("nan"))
open("nan.ply", "wb").write(data)'
expect_document 4 encode nan.ply -o x.l4d --preset lossless
expect_json out 'd["error"]["name"] == "L4D_ERR_INVALID_SCENE"'
expect_missing x.l4d
expect_document 0 encode nan.ply -o x.l4d --drop-invalid
expect_json out 'd["invalid_dropped"] == 1 and d["coded_gaussians"] == 2999'
# What renderers refuse is not looked at.
expect_json out '"sensitivity" not in d'
expect_json out 'any("importance is estimated, without views that are made up: nan.ply" in n for n in d["notes"])'

# A scene that comes without cameras and weights is looked at, for any number of threads; nothing of it is pruned.
expect_document 0 encode s.ply -o looked.l4d
expect_json out 'd["sensitivity"]["made_up"] and d["sensitivity"]["views_measured"] == 36 and d["pruned"] == 0'
expect 0 encode s.ply -o threads.l4d --threads 3
cmp looked.l4d threads.l4d
expect_text out 'importance from 36 of 36 made-up views'
for options in --estimate '--preset lossless' '--preset paper-small --set prune-weight=-1'; do
  # shellcheck disable=SC2086
  expect_document 0 encode s.ply -o plain.l4d -f $options
  expect_json out '"sensitivity" not in d'
  if cmp -s looked.l4d plain.l4d; then die "views do nothing"; fi
done
for options in '--weights w.ply' '--orbit 3'; do
  # shellcheck disable=SC2086
  expect 2 encode s.ply -o misused.l4d --estimate $options
done
expect_missing misused.l4d
# Cameras, too, of which some are left out, prune nothing.
expect_document 0 encode s.ply -o orbit.l4d --orbit 3 --frames 0
expect_json out 'not d["sensitivity"]["made_up"] and d["pruned"] == 0'

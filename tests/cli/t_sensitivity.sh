# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# Importance from views: its file, and encoding with it.
make_scene s.ply 3000
make_cameras c.json

expect_document 0 sensitivity s.ply --cameras c.json --all-views -o w.ply
expect_json out 'd["views"] == d["views_measured"] == 120 and d["views_visibility_only"] == 0'
expect_json out 'd["num_gaussians"] == 3000 and not d["agreed"] and d["unseen"] < 1500'
unseen=$(json out 'd["unseen"]')
expect_json out 'd["metric"] == "gauss-newton"'
# Columns larger for what shows, nothing for what does not.
cat > columns.py << 'END'
import struct


def columns(name, measure):
    data = open(name, "rb").read()
    at = data.index(b"end_header\n") + 11
    header = data[:at].decode()
    assert "comment l4d_weights 1\n" in header and "element vertex 3000\n" in header
    assert "comment metric %s\n" % measure in header
    names = [line.split()[2] for line in header.splitlines() if line.startswith("property float ")]
    rows = list(struct.iter_unpack("<%df" % len(names), data[at:]))
    assert len(rows) == 3000
    return dict(zip(names, zip(*rows)))
END
"$PYTHON" -c "
from columns import columns
w = columns('w.ply', 'gauss-newton')
assert list(w) == ['alpha_t', 'weight_sh', 'weight_scale', 'weight_rotor_spatial',
                   'weight_rotor_temporal', 'weight_position', 'weight_opacity', 'weight_mean_t']
assert all(x >= 0 for column in w.values() for x in column)
assert sum(x == 0 for x in w['alpha_t']) == $unseen
assert all(w['weight_sh'][i] == 0 for i in range(3000) if w['alpha_t'][i] == 0)
assert all(sum(x > 0 for x in column) > 1000 for column in w.values())"
expect 3 sensitivity s.ply --cameras c.json -o w.ply
# Reproducible, for any number of threads.
expect 0 sensitivity s.ply --cameras c.json --all-views -o again.ply --threads 3
cmp w.ply again.ply

# Fewer views, and the same Gaussians seen.
expect_document 0 sensitivity s.ply --orbit 9 --size 64x48 --frames 0:60:2 --all-views -o every.ply
all_unseen=$(json out 'd["unseen"]')
expect_document 0 sensitivity s.ply --orbit 9 --size 64x48 --frames 0:60:2 --agreement 0.5 --visibility all -o requested.ply
expect_json out 'd["agreed"] and d["views_measured"] < 270 == d["views_measured"] + d["views_visibility_only"]'
expect_json out "d['unseen'] == $all_unseen and min(d['agreement'].values()) >= 0.5"
# By default asking ends where hardly anything is new, and with it none is asked.
expect_document 0 sensitivity s.ply --orbit 9 --size 64x48 --frames 0:60:2 --agreement 0.5 -o few.ply
expect_json out "0 < d['views_visibility_only'] < 270 - d['views_measured'] and d['unseen'] >= $all_unseen"
few_unseen=$(json out 'd["unseen"]')
expect_document 0 sensitivity s.ply --orbit 9 --size 64x48 --frames 0:60:2 --agreement 0.5 --visibility none -o none.ply
expect_json out "d['views_visibility_only'] == 0 and d['unseen'] > $few_unseen"
expect 2 sensitivity s.ply --orbit 9 --visibility some -o none.ply
expect_document 0 sensitivity s.ply --cameras c.json --max-share 0.1 --split all -o share.ply
expect_json out 'd["views"] == 240 and d["views_measured"] <= 60'
# The measures share what they cover and nothing else.
for metric in sum gauss-newton; do
  expect_document 0 sensitivity s.ply --orbit 2 --size 64x48 --frames 0:60:30 --metric $metric -o $metric.ply
  expect_json out "d['views'] == 4 and d['metric'] == '$metric'"
done
"$PYTHON" -c "
from columns import columns
a, b = columns('sum.ply', 'sum'), columns('gauss-newton.ply', 'gauss-newton')
assert [name for name in a if a[name] == b[name]] == ['alpha_t']"

# encode takes them from the file or measures for itself, with one result: cameras also say how small
# a Gaussian can look.
expect_document 0 encode s.ply -o file.l4d --preset indexed --codebook all=64 --weights w.ply --cameras c.json \
  --prune-weight 0 --set prune-cost=0
expect_json out "d['pruned'] == $unseen and 'sensitivity' not in d"
expect_document 0 encode s.ply -o own.l4d --preset indexed --codebook all=64 --set prune-cost=0 --cameras c.json \
  --all-views --save-weights own.ply
expect_json out "d['pruned'] == $unseen == d['sensitivity']['unseen'] == 3000 - d['coded_gaussians']"
expect_json out 'd["steps"]["sensitivity"] == d["sensitivity"]["seconds"] < d["total_s"]'
cmp own.ply w.ply
cmp own.l4d file.l4d
expect 0 validate own.l4d
# The weights matter: without them other codewords come out.
expect 0 encode s.ply -o plain.l4d
if cmp -s plain.l4d own.l4d; then die "weights do nothing"; fi

# Nothing is dropped where views were left out, or nothing may be.
expect_document 0 encode s.ply -o x.l4d --cameras c.json --frames 0:60:30 --verify
expect_json out 'd["pruned"] == 0 and d["verify"]["matched"] == 3000 and any("kept" in n for n in d["notes"])'
expect_document 0 encode s.ply -o x.l4d --cameras c.json --no-prune --force
expect_json out 'd["pruned"] == 0 and d["notes"] == []'
expect_document 0 encode s.ply -o x.l4d --orbit 2 --frames 30 --prune-weight 0 --force
expect_json out 'd["pruned"] > 0'
expect_document 0 encode s.ply -o lossless.l4d --preset lossless --cameras c.json --frames 30
expect_json out 'd["pruned"] == 0'
expect 0 compare s.ply lossless.l4d --exact

# A stream will do as the scene.
expect_document 0 sensitivity lossless.l4d --cameras c.json --frames 0:60:20 -o l.ply
expect_json out 'd["num_gaussians"] == 3000'
expect 0 encode lossless.l4d -o y.l4d --weights l.ply
expect 4 encode plain.l4d -o z.l4d --weights s.ply

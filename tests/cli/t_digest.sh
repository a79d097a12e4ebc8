# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# Digests and raw arrays. What they are is held against another reader in tests/spec/digests_test.py.
make_scene s.ply 4000
expect 0 encode s.ply -o s.l4d --set merge-count=0 --set merge-fraction=0
expect 0 encode s.ply -o i.l4d --preset indexed --profile indexed --codebook all=64

# One answer on every path and for any number of threads; another for every part of the stream.
expect 0 decode s.l4d --digest
cp out all
expect_missing s.safetensors
expect_equal "$(wc -l < all)" 10
expect_text all '^[0-9a-f]{16}  position f32 \[4000, 3\]$'
expect_text all '^[0-9a-f]{16}  all 4000$'
for options in '--backend reference' '--threads 1' '--threads 5'; do
  # shellcheck disable=SC2086
  expect 0 decode s.l4d --digest $options
  cmp out all
done
for options in '--time 0.7' '--from 0.2 --to 0.9' '--max-level 0' '--detail base' '--packed'; do
  # shellcheck disable=SC2086
  expect_document 0 decode i.l4d --digest $options
  expect_json out 'd["output"] is None and d["format"] is None and d["file_bytes"] == 0'
  json out 'd["digests"]["all"]' >> parts
done
expect 0 decode i.l4d --digest
tail -n 1 out | cut -d' ' -f1 >> parts
# Codebooks have no colours of their own for --detail base where pages are small: those two are one.
expect_equal "$(sort parts | uniq | wc -l)" 5

# --quiet leaves what was asked for.
cp out loud
expect 0 decode i.l4d --digest -q
cmp -s out loud || die 'with --quiet no digests'
expect 0 slice i.l4d --time 0.5 --digest
cp out loud
expect 0 slice i.l4d --time 0.5 --digest -q
cmp -s out loud || die 'with --quiet no digests of a slice'

# One bit of one array, the digest of that array and of all.
expect_document 0 decode s.l4d --digest
cp out document
expect 0 encode s.ply -o t.l4d --set merge-count=0 --set merge-fraction=0 --quality 30
expect 0 decode t.l4d --digest
[ "$(tail -n 1 out)" != "$(tail -n 1 all)" ] || die 'another stream has the same digest'

# The file holds what is hashed, and says where.
expect_document 0 decode s.l4d --format raw --digest
expect_json out 'd["output"] == "s.safetensors" and d["format"] == "raw" and d["file_bytes"] > 100000'
expect_equal "$(json out 'd["digests"]')" "$(json document 'd["digests"]')"
"$PYTHON" - << 'PYTHON'
import json, struct
data = open("s.safetensors", "rb").read()
n = struct.unpack("<Q", data[:8])[0]
header, end = json.loads(data[8:8 + n]), 0
meta = header.pop("__metadata__")
assert meta["num_gaussians"] == "4000" and meta["form"] == "attributes", meta
for name, a in header.items():
    size = int(a["dtype"][1:]) // 8
    for k in a["shape"]:
        size *= k
    assert a["data_offsets"] == [end, end + size], name
    end += size
assert 8 + n + end == len(data)
begin, stop = header["opacity"]["data_offsets"]
values = struct.unpack("<4000f", data[8 + n + begin:8 + n + stop])
assert 0 <= min(values) and max(values) <= 1 and len(set(values)) > 50
PYTHON
expect 0 decode i.l4d --format raw --packed -o -
cp out packed
expect_text packed '"form":"packed"'
expect 3 decode s.l4d --format raw
expect 0 decode s.ply --digest
expect_text out 'all 4000$'

# Slices.
expect_document 0 slice s.l4d --time 0.5 --digest
expect_json out 'len(d["frames"]) == 1 and len(d["frames"][0]["digests"]["arrays"]) == 4'
expect_json out 'any("not normative" in n for n in d["notes"])'
one=$(json out 'd["frames"][0]["digests"]["all"]')
expect 0 slice s.l4d --time 0.5 --digest
expect_text out "^$one  all "
expect_text err 'not normative'
expect 0 slice s.l4d --from 0 --to 1 --fps 2 --digest
expect_equal "$(grep -c '^frame ' out)" 2
expect_text out "^$one  all "

# Damage: what is left has digests too.
"$PYTHON" - << 'PYTHON'
data = bytearray(open("i.l4d", "rb").read())
data[-1] ^= 1
open("bad.l4d", "wb").write(data)
PYTHON
expect 4 decode bad.l4d --digest
for form in '' --packed; do
  # shellcheck disable=SC2086
  expect_document 0 decode bad.l4d --digest --tolerant $form
  expect_json out 'd["losses"] and 0 < d["digests"]["num_gaussians"] < 4000'
  expect_json out 'all(d["num_gaussians"] in a["shape"] or a["name"].endswith(".escape")
                       or a["name"] == "buckets" for a in d["digests"]["arrays"])'
done

# What does not go together.
expect 5 decode s.l4d --digest --packed
expect 2 decode s.l4d --packed
expect_text err 'packed needs'
expect 2 decode s.l4d --digest -o o.ply
expect 2 decode s.l4d --digest --format ftgs
expect 2 decode s.l4d --format raw -o o.ply
expect 2 slice s.l4d --time 0.5 --digest -o o.ply
expect 2 slice s.l4d --time 0.5
expect_text err 'output is required'
expect 6 decode s.l4d --digest --limit-memory 1k
expect_missing o.ply

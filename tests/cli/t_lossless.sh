# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# A lossless stream gives back the bits of the input, in any order.
make_scene s.ply 20k
expect_document 0 encode s.ply -o s.l4d --preset lossless --order s.order --verify
expect_json out 'd["input_gaussians"] == d["coded_gaussians"] == 20000 and d["preset"] == "lossless"'
expect_json out 'd["raw_bytes"] == 20000 * 4 * (17 + 48)'
expect_json out 'd["file_bytes"] == '"$(wc -c < s.l4d)"
expect_json out 'abs(d["ratio"] - d["raw_bytes"] / d["file_bytes"]) < 1e-9'
expect_json out 'abs(sum(d["steps"].values()) - d["total_s"]) < 0.2 * d["total_s"] + 0.05'
expect_json out 'd["verify"]["identical"] and d["verify"]["match"] == "order"'
expect_json out 'd["verify"]["visible_position"]["max"] == 0'

expect_document 0 decode s.l4d -o back.ply
expect_json out 'd["lossless"] and d["num_gaussians"] == 20000'
for order in '' '--order s.order'; do
  for b in s.l4d back.ply; do
    [ "$b$order" != "back.ply--order s.order" ] || continue
    # shellcheck disable=SC2086
    expect_document 0 compare s.ply "$b" --exact $order
    expect_json out 'd["identical"] and d["equal_rows"] == 20000 and d["unmatched"] == 0'
    expect_json out 'all(e == {"max": 0, "rmse": 0} for e in d["attributes"].values())'
  done
done

# The same vertex rows as bytes, whatever this project's own reader thinks.
rows() {
  "$PYTHON" -c 'import sys
data = open(sys.argv[1], "rb").read()
at = data.index(b"end_header\n") + 11
body = data[at:]
size = len(body) // 20000
assert len(body) == size * 20000
for row in sorted(body[i : i + size] for i in range(0, len(body), size)):
    print(row.hex())' "$1"
}
rows s.ply > a.rows
rows back.ply > b.rows
cmp a.rows b.rows

# Coding again, from the stream itself, changes nothing more.
expect 0 encode s.l4d -o again.l4d --preset lossless
expect 0 compare s.ply again.l4d --exact

# One float of one row changed is found.
"$PYTHON" -c 'import sys
data = bytearray(open("back.ply", "rb").read())
data[-1] ^= 1
open("changed.ply", "wb").write(data)'
expect_document 1 compare s.ply changed.ply --exact
expect_json out 'not d["identical"] and d["equal_rows"] == 19999 and d["match"] == "unknown"'
expect_json out 'd["matched"] == 19999 and d["not_met"] == ["the scenes are identical"]'

# Threads and backends change nothing.
expect 0 encode s.ply -o one.l4d --preset lossless --threads 1
cmp s.l4d one.l4d
for options in '--threads 1' '--threads 3' '--backend reference' '--backend cpu'; do
  # shellcheck disable=SC2086
  expect 0 decode s.l4d -o other.ply --force $options
  cmp back.ply other.ply
done

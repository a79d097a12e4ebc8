# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# validate, and what damaged input does to every verb.
make_scene s.ply 5000
expect 0 encode s.ply -o s.l4d
expect_document 0 validate s.l4d
expect_json out 'd["valid"] and d["errors"] == [] and d["num_errors"] == 0'
expect 0 validate s.l4d
expect_text out '^s.l4d: valid'
l4d validate - < s.l4d > out

# What is no stream at all.
expect_document 4 validate s.ply
expect_json out 'not d["valid"] and d["errors"][0]["status"] == "L4D_ERR_NOT_L4D"'
: > empty.l4d
expect_document 4 validate empty.l4d
expect_document 4 info empty.l4d
expect_document 3 validate missing.l4d

# Bytes changed or missing, at many places: found, never passed, never a crash.
damage() {
  "$PYTHON" -c 'import sys
data = bytearray(open("s.l4d", "rb").read())
at = int(sys.argv[1]) * (len(data) - 1) // 100
if sys.argv[2] == "flip":
    data[at] ^= 0x40
else:
    del data[at:]
open("bad.l4d", "wb").write(data)' "$1" "$2"
}
for percent in 0 1 3 10 25 50 75 90 97 99 100; do
  for how in flip cut; do
    damage $percent $how
    status=0
    l4d validate bad.l4d --json > out 2> err || status=$?
    expect_empty err
    case $status in
      1 | 4 | 5) expect_json out 'not d["valid"] and d["num_errors"] > 0' ;;
      *) die "damage at $percent %, $how: exit status $status" ;;
    esac
    status=0
    l4d decode bad.l4d -o bad.ply --force -q 2> err || status=$?
    case $status in
      4 | 5 | 6) expect_missing bad.ply ;;
      *) die "decode of damage at $percent %, $how: exit status $status" ;;
    esac
    expect_text err '^l4dcodec: bad.l4d: '
  done
done

# Violations have a clause and a place, and a list can be cut short.
damage 75 flip
expect_document 1 validate bad.l4d
expect_json out 'd["errors"][0]["clause"] and d["errors"][0]["offset"] is not None'
expect_document 1 validate bad.l4d --max-errors 0
expect_json out 'd["errors"] == [] and d["num_errors"] > 0'
expect 1 validate bad.l4d -q
expect_empty out

# What this build cannot read is reported like everything else, with the clause: a major version, a
# flag.
unknown() {
  PYTHONPATH=$ROOT/conformance/reference "$PYTHON" -B -c 'import sys
from xxh3 import xxh3_64
data = bytearray(open("s.l4d", "rb").read())
data[int(sys.argv[1])] ^= int(sys.argv[2])
data[32:40] = xxh3_64(bytes(data[:32])).to_bytes(8, "little")
open("new.l4d", "wb").write(data)' "$1" "$2"
}
unknown 8 6
expect_document 5 validate new.l4d
expect_json out 'd["schema"] == "l4dcodec.validate/1" and not d["valid"]'
expect_json out '[e["clause"] for e in d["errors"]] == ["FILE-2"]'
expect_json out 'd["errors"][0]["status"] == "L4D_ERR_VERSION_UNSUPPORTED"'
expect 5 validate new.l4d
expect_text out 'FILE-2 +byte 8 '
unknown 11 128
expect_document 5 validate new.l4d
expect_json out '[e["clause"] for e in d["errors"]] == ["FILE-3"]'

# Limits: a valid stream that this reader is told not to afford.
expect_document 6 decode s.l4d -o x.ply --limit-memory 1k
expect_json out 'd["error"]["name"] == "L4D_ERR_LIMIT_EXCEEDED"'
expect_missing x.ply

# Broken PLY.
printf 'ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1\n' > odd.ply
expect_document 5 encode odd.ply -o x.l4d
head -c 1000 s.ply > cut.ply
expect_document 4 encode cut.ply -o x.l4d
expect_missing x.l4d

# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# sign, keygen and validate --key; a verifier in Python says whether signatures are right.
status=0
l4d keygen -o own.key > out 2> err || status=$?
if [ "$status" -eq 5 ]; then
  expect_text err 'no signatures'
  echo "skipped: the tool was built without libsodium"
  exit 77
fi
[ "$status" -eq 0 ] || die "keygen: exit status $status"
verify() { "$PYTHON" -B "$ROOT/conformance/reference/signature.py" "$1"; }
# The formulas of the verifier give the test vector of RFC 8032, section 7.3.
"$PYTHON" -B - "$ROOT" << 'PY' || die "the verifier is wrong"
import hashlib, sys
sys.path.insert(0, sys.argv[1] + "/conformance/reference")
import signature as s
seed = bytes.fromhex("833fe62409237b9d62ec77587520911e9a759cec1d19755b7da901b96dca3d42")
known = bytes.fromhex("98a70222f0b8121aa9d30f813d683f809e462b469c7ff87639499bb94e6dae41"
                      "31f85042463c2a355a2003d062adf5aaa10b8c61e636062aaad11c2a26083406")
key = s.public_key(seed)
assert s.is_right(key, known, hashlib.sha512(b"abc").digest())
assert not s.is_right(key, known, hashlib.sha512(b"abd").digest())
PY
[ "$(stat -c %a own.key)" = 600 ] || die "others can read the secret key"
expect 3 keygen -o own.key
expect 3 keygen -f -o own.key
expect_text err 'never replaces a key'
expect 0 keygen -o other.key

make_scene s.ply 2k
expect 0 encode s.ply -o s.l4d
expect_document 0 validate s.l4d
expect_json out 'd["signature"] is None'
expect 1 validate s.l4d --key own.key.pub
expect_text out 'not signed'
expect_document 0 sign s.l4d -o signed.l4d --key own.key
expect_json out "d['file_bytes'] == $(($(wc -c < s.l4d) + 100))"
[ "$(verify signed.l4d)" = "$(cut -d' ' -f2 own.key.pub) right" ] || die "no right signature"
expect 0 validate signed.l4d --key own.key.pub
expect_document 0 validate signed.l4d
expect_json out 'd["signature"]["right"] and d["valid"]'
expect 1 validate signed.l4d --key other.key.pub
# Players ignore it, and signing again replaces it.
expect 0 decode --digest s.l4d
cp out digest
expect 0 decode --digest signed.l4d
cmp out digest || die "a signature changes attributes"
expect 0 sign signed.l4d -o again.l4d --key other.key
[ "$(wc -c < again.l4d)" = "$(wc -c < signed.l4d)" ] || die "a second signature"
expect 0 validate again.l4d --key other.key.pub
expect 0 sign again.l4d -o - --key own.key
cmp out signed.l4d || die "equal bytes and keys give equal signatures"

# One changed byte anywhere is noticed, also where no rule of the format would.
cp signed.l4d changed.l4d
printf '\x55' | dd of=changed.l4d bs=1 seek="$(($(wc -c < changed.l4d) / 2))" conv=notrunc 2> /dev/null
expect 1 validate changed.l4d --key own.key.pub
expect_text out 'not of these bytes'
[ "$(verify changed.l4d)" = "$(cut -d' ' -f2 own.key.pub) wrong" ] || die "a wrong one is right"
head -c -1 signed.l4d > short.l4d
expect 1 validate short.l4d --key own.key.pub

# What is no key, and what must not be overwritten.
expect 4 validate signed.l4d --key s.ply
expect 4 sign s.l4d -o x.l4d --key own.key.pub
expect 2 sign s.l4d -o own.key --key own.key -f
expect 2 sign s.l4d -o s.l4d --key own.key -f
[ ! -e x.l4d ] || die "an output of a failed command"

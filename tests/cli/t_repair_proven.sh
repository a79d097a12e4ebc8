# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# What repair keeps decodes and breaks no rule, also of files whose checksums are right.
kept=0 refused=0
for file in "$ROOT"/conformance/vectors/faulty/*.l4d; do
  status=0
  l4d repair "$file" -o repaired.l4d -q -f > out 2> err || status=$?
  if [ "$status" -eq 0 ]; then
    kept=$((kept + 1))
    expect 0 validate repaired.l4d
    # A member that needs others is no stream of its own.
    status=0
    l4d decode repaired.l4d -o repaired.ply -q -f 2> err || status=$?
    [ "$status" -eq 0 ] || expect_text err "a member that needs others"
  else
    refused=$((refused + 1))
  fi
done
# What is wrong in a page costs that page, what is wrong in a member costs the member.
[ "$kept" -gt 120 ] || die "only $kept faulty files are repaired"
[ "$refused" -gt 50 ] || die "only $refused faulty files are refused"
echo "  $kept kept, $refused refused"

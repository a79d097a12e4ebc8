#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: contraction.sh OBJDUMP OBJECT...
# What a stream decodes to must not depend on fused multiply-add. -ffp-contract=off forbids it, but
# compilers have had gaps there (vectorised a*b+c beside a*b-c), so the objects themselves are looked at.
set -euo pipefail
objdump=$1
shift
(($# > 0)) || { echo "no objects given" >&2; exit 1; }
case $(uname -m) in
  x86_64) fused='\bvf(n?m(add|sub)|maddsub|msubadd)' ;;
  aarch64) fused='\bf(n?madd|n?msub|mla|mls)\b' ;;
  *) echo "SKIPPED: no pattern for $(uname -m)"; exit 77 ;;
esac
found=0
instructions=0
for object in "$@"; do
  listing=$("$objdump" -d --no-show-raw-insn "$object")
  instructions=$((instructions + $(grep -c . <<<"$listing")))
  if matches=$(grep -E "$fused" <<<"$listing"); then
    echo "$object:"
    head -5 <<<"$matches"
    found=1
  fi
done
((instructions > 1000)) || { echo "the disassembly is empty" >&2; exit 1; }
((found == 0)) && echo "no fused multiply-add in $# objects"
exit $found

#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: elf.sh [--stack-protector] [--fortify] FILE...
# Programs and shared libraries of this build: libraries are looked for in no relative or empty
# folder, the stack holds no code, all is bound before main() and then read-only, and the place in
# memory is the loader's choice. With --stack-protector a function that returns looks whether the
# stack was written over, with --fortify copies into buffers of known size look at that size.
set -euo pipefail
command -v readelf >/dev/null || {
  echo "skipped: no readelf"
  exit 77
}

wanted=()
while [[ ${1:-} == --* ]]; do
  case $1 in
    --stack-protector) wanted+=(__stack_chk_fail) ;;
    --fortify) wanted+=('__(mem|str|v?sn?|v?f?)[a-z]*_chk') ;;
    *) echo "usage: elf.sh [--stack-protector] [--fortify] FILE..." >&2 && exit 2 ;;
  esac
  shift
done

# check FILE: prints what is wrong.
check() {
  local file=$1 dynamic headers symbols symbol path entries entry
  headers=$(readelf -hlW "$file" 2>/dev/null) || {
    echo "$file: no ELF file"
    return
  }
  dynamic=$(readelf -dW "$file")
  grep -qE '^ *Type: +DYN' <<<"$headers" || echo "$file: position is fixed"
  grep -qE '^ +GNU_STACK .* RW ' <<<"$headers" || echo "$file: the stack can hold code"
  grep -q ' GNU_RELRO ' <<<"$headers" || echo "$file: no RELRO"
  grep -qE 'BIND_NOW|Flags:.* NOW' <<<"$dynamic" || echo "$file: no BIND_NOW"
  symbols=$(readelf --dyn-syms -W "$file" | awk '$7 == "UND" { sub(/@.*/, "", $8); print $8 }')
  for symbol in "${wanted[@]}"; do
    grep -qxE "$symbol" <<<"$symbols" || echo "$file: does not call $symbol"
  done
  path=$(sed -nE 's/.*\((RPATH|RUNPATH)\).*\[(.*)\]$/\2/p' <<<"$dynamic")
  [[ -n $path ]] || return 0
  # A separator behind the last entry shows an empty one there too.
  mapfile -t entries < <(tr ':' '\n' <<<"$path")
  for entry in "${entries[@]}"; do
    # shellcheck disable=SC2016  # the loader expands it
    [[ $entry == /* || $entry == '$ORIGIN' || $entry == '$ORIGIN/'* ]] ||
      echo "$file: looks for libraries in '$entry' ($path)"
  done
}

wrong=$(for file in "$@"; do check "$file"; done)
if [[ -n $wrong ]]; then
  echo "$wrong" >&2
  exit 1
fi
# The checks see something: a file that is none of that.
if command -v cc >/dev/null; then
  work=$(mktemp -d)
  trap 'rm -rf "$work"' EXIT
  echo 'int main(void) { return 0; }' >"$work/weak.c"
  cc -U_FORTIFY_SOURCE -fno-stack-protector "$work/weak.c" -o "$work/weak" -no-pie -Wl,-z,norelro,-z,lazy,-z,execstack,-rpath,: 2>/dev/null
  [[ $(check "$work/weak" | wc -l) -ge $((5 + ${#wanted[@]})) ]] || {
    check "$work/weak" >&2
    echo "FAIL: a program that is open to all passes for a closed one" >&2
    exit 1
  }
fi
echo "$# files hardened"

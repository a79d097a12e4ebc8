#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Runs the tests of the command-line tool: run.sh TOOL [NAME...], all of them without a name.
# Exit status: 0 passed, 1 something failed, 77 everything asked for was skipped.
set -euo pipefail

here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
root=$(cd "$here/../.." && pwd)
if [ $# -lt 1 ] || [ ! -x "$1" ]; then
  echo "usage: run.sh TOOL [NAME...]" >&2
  exit 2
fi
tool=$(cd "$(dirname "$1")" && pwd)/$(basename "$1")
shift
if [ $# -eq 0 ]; then
  for script in "$here"/t_*.sh; do
    name=$(basename "$script" .sh)
    set -- "$@" "${name#t_}"
  done
fi

passed=0 failed=0 skipped=0
for name in "$@"; do
  folder=$(mktemp -d)
  status=0
  (
    cd "$folder"
    L4DCODEC=$tool PAGES=$(dirname "$tool")/../pages ROOT=$root DATA=${L4D_DATA_DIR:-$root/../shared/data} \
      PYTHON=${PYTHON:-python3} bash -euo pipefail -c '. "$1"; . "$2"' _ \
      "$here/lib.sh" "$here/t_$name.sh"
  ) || status=$?
  case $status in
    0) passed=$((passed + 1)) && echo "PASS $name" ;;
    77) skipped=$((skipped + 1)) && echo "SKIP $name" ;;
    *) failed=$((failed + 1)) && echo "FAIL $name (status $status)" ;;
  esac
  rm -rf "$folder"
done
echo "$passed passed, $failed failed, $skipped skipped"
[ "$failed" -eq 0 ] || exit 1
[ "$passed" -gt 0 ] || exit 77

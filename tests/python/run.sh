#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Tests of the Python package. Exit status 77: it was not built, or what tests it is not installed.
# usage: run.sh pytest|mypy PYTHON FOLDER TOOL [ARGUMENT...]
# FOLDER: the one that has the package l4dcodec, of a build. TOOL: l4dcodec of the same build.
set -euo pipefail
what=$1 python=$2 folder=$3 tool=$4
shift 4
source=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
needs=(numpy cffi pytest hypothesis)
[[ $what == pytest ]] || needs=(numpy mypy)
for module in "${needs[@]}"; do
  if ! "$python" -c "import $module" 2>/dev/null; then
    echo "SKIPPED: $python has no $module (./dev setup python)"
    exit 77
  fi
done
if [[ ! -e $folder/l4dcodec/_native.abi3.so ]]; then
  echo "SKIPPED: this build has no Python package (L4D_PYTHON, docs/building.md)"
  exit 77
fi
export PYTHONPATH=$folder PYTHONDONTWRITEBYTECODE=1 L4D_TOOL=$tool L4D_SOURCE=$source
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
if [[ $what == mypy ]]; then
  # As a user of the package sees it, and its own modules.
  "$python" -m mypy --strict --cache-dir "$work" "$folder/l4dcodec" "$source"/tests/python/*.py
else
  "$python" -m pytest -q -p no:cacheprovider --hypothesis-seed=2027 --rootdir "$source/tests/python" "$source/tests/python" "$@"
fi

#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Tests of the Python package. Exit status 77: it was not built, or what tests it is not installed.
# usage: run.sh pytest|mypy|blender PYTHON FOLDER TOOL [ARGUMENT...]
# FOLDER: the one that has the package l4dcodec, of a build. TOOL: l4dcodec of the same build.
set -euo pipefail
what=$1 python=$2 folder=$3 tool=$4
shift 4
source=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
needs=(numpy cffi pytest hypothesis)
case $what in
  mypy) needs=(numpy pytest hypothesis mypy) ;;
  blender) needs=(numpy cffi) ;;
esac
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
if [[ $what == blender ]] && ! command -v blender >/dev/null; then
  echo "SKIPPED: there is no Blender (./dev setup blender)"
  exit 77
fi
export PYTHONPATH=$folder PYTHONDONTWRITEBYTECODE=1 L4D_TOOL=$tool L4D_SOURCE=$source
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
if [[ $what == mypy ]]; then
  # As a user of the package sees it, and its own modules. Of the add-on, what needs no Blender, which has no types.
  cp "$source/python/blender/l4d_import/arrays.py" .
  "$python" -m mypy --strict --cache-dir "$work" "$folder/l4dcodec" "$source"/tests/python/{conftest,test_*}.py \
    arrays.py
elif [[ $what == blender ]]; then
  "$tool" synth --seconds 2 --gaussians 4000 -o scene.ply
  "$tool" encode scene.ply -o scene.l4d
  "$tool" encode scene.ply --preset lossless -o lossless.l4d
  mkdir frames
  "$tool" slice scene.l4d --from 0 --to 0.2 --fps 30 -o frames/f_%02d.ply
  # Debian's Blender has the Python of the system. The add-on comes out of the file that people install.
  PATH=/usr/bin:$PATH blender -b --factory-startup --python-use-system-env --python-exit-code 1 \
    --python "$source/tests/python/blender.py" -- "$folder/l4d_import.zip" "$work" | grep -v '^Fra:'
else
  "$python" -m pytest -q -p no:cacheprovider --hypothesis-seed=2027 --rootdir "$source/tests/python" "$source/tests/python" "$@"
fi

# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# Every verb accepts what every other verb writes: random walks. More of them: verbs.py --walks N.
"$PYTHON" -B "$ROOT/tests/cli/verbs.py" "$L4DCODEC" --walks 12 --seed 1 || die "a walk failed"

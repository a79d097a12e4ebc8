# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# A live loop of ten seconds: pieces appear, encode --live follows, serve serves, and a player shows every
# member that the playlist lists (bench/live/loop.py prints the delay; that of a busy machine is no test).
need_server
"$PYTHON" -B "$ROOT/bench/live/loop.py" "$L4DCODEC" --seconds 10 --segment 1 --gaussians 10k > out || {
  cat out >&2
  die "the loop failed"
}
cat out
expect_text out '^\| 10 \| 1 \|'

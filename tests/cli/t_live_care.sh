# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# encode --live at the edges: files that were there, second writers, bad pieces, interrupts, full disks.
l4d synth -q -n 3k --seconds 4 --fps 30 --seed 3 -o s.ply
expect 0 encode s.ply -o old.l4d

wait_for() { # CONDITION...: until it holds
  local _
  for _ in $(seq 400); do
    if "$@"; then return; fi
    sleep 0.05
  done
  die "never: $*"
}
temporaries() { find . -name '*.l4dtmp*' | grep -q .; }
has_segments() { [ "$(grep -c EXTINF "$1" 2> /dev/null)" -ge "$2" ]; }

# The old file is there until the first member of the new one is, and stays where there is none.
cp old.l4d out.l4d
cp old.l4d kept.l4d
printf '#EXTM3U\nold\n' > out.m3u8
mkdir in
expect 3 encode --live in -o out.l4d
l4d encode --live in -f -o out.l4d --playlist out.m3u8 -q 2> first.err &
first=$!
wait_for temporaries
cmp out.l4d kept.l4d || die "the old file is gone"
expect_text out.m3u8 old
# One writer at a time: before its first member, and after it.
expect 3 encode --live in -f -o out.l4d
expect_text err 'out.l4d: another process is writing this file'
cp s.ply in/.0
mv in/.0 in/0.ply
wait_for has_segments out.m3u8 2
expect 3 encode --live s.ply -f -o out.l4d
expect_text err 'another process is writing this file'
touch in/end
wait "$first"
expect_document 0 validate out.l4d
if temporaries; then die "temporary files are left"; fi
expect 0 encode --live s.ply -f -o out.l4d
expect 0 validate out.l4d
rm in/*
touch in/end
cp old.l4d out.l4d
expect 4 encode --live in -f -o out.l4d --playlist new.m3u8
expect_text err 'without a piece'
cmp out.l4d kept.l4d || die "an old file is gone, and there is no new one"
expect_missing new.m3u8 none.l4d
expect 4 encode --live in -o none.l4d
expect_missing none.l4d

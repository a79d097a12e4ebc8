# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# shellcheck disable=SC2154  # start_server says url
# The example player over sockets, against the server of the tool.
players=("$(dirname "$L4DCODEC")"/l4d_example_player_http{,_cpp})
need_server
[ -x "${players[0]}" ] || skip "no sockets of POSIX"
mkdir files
l4d synth --scene cloud --seconds 2 --gaussians 2000 -q -o scene.ply
l4d encode scene.ply --estimate -q -o files/scene.l4d
l4d encode scene.ply --estimate --live --segment 1 --playlist files/live.m3u8 -q -o files/live.l4d
head -c 3000 /dev/zero > files/zeros.l4d
start_server serve files

for player in "${players[@]}"; do
  for name in scene.l4d live.m3u8; do
    "$player" "$url$name" > out || die "the player fails on $name: $(cat out)"
    expect_text out '^[0-9.]+ s: [1-9][0-9]* Gaussians, rung [0-9] of [0-9], [1-9][0-9]* bytes$'
    expect_text out '^shown for 2.0 s, '
  done
  for name in none.l4d zeros.l4d; do
    if "$player" "$url$name" > out 2> err; then die "$name plays"; fi
    expect_text err 'cannot be played: L4D_CAUSE_NOT_(FOUND|L4D)$'
  done
done
end_server
for player in "${players[@]}"; do
  if "$player" "${url}scene.l4d" 20 > out 2> err; then die "it plays without a server"; fi
  expect_text err '^again in '
  expect_text err 'cannot be played: L4D_CAUSE_NETWORK$'
  for wrong in '' https://127.0.0.1/s.l4d http://127.0.0.1; do
    if "$player" "$wrong" > out 2> err; then die "'$wrong' plays"; fi
    expect_text err '^usage'
  done
done

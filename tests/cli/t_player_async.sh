# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# The example player over the playback engine, on a simulated link.
player=$(dirname "$L4DCODEC")/l4d_example_player_async
l4d synth --scene cloud --seconds 60 --gaussians 20000 -o scene.ply > log
l4d encode scene.ply --quiet -o scene.l4d > log

# Column N of a line of the player.
column() { grep "^$1" out | tr -s ' ' '\n' | grep -A1 -B1 "^$2" | head -n 1; }
at_most() { awk -v a="$1" -v b="$2" 'BEGIN { exit !(a <= b) }' || die "$3 is $1, more than $2"; }

"$player" scene.l4d 20 0.05 10 20 > out || die "the player fails: $(cat out)"
at_most "$(column 'first picture' rounds)" 4 "rounds to the first picture"
at_most "$(column 'a seek' rounds)" 2 "rounds to a seek"
expect_text out '^ +0 stalls'
# The same link gives the same figures.
cp out first
"$player" scene.l4d 20 0.05 10 20 > out
cmp first out
# A link that is too slow stalls, and plays on.
"$player" scene.l4d 0.005 0.2 3 0 > out || die "the player fails on a slow link"
expect_text out '^ +[1-9][0-9]* stalls'

# With tiers a first picture takes less; where the link allows, the picture ends in full.
l4d encode scene.ply --quiet --tiers 0.15,0.5 -o tiers.l4d > log
"$player" tiers.l4d 20 0.05 10 0 > tiers
expect_text tiers 'at the end rung 4 of 4$'
expect_text tiers '^ +0 stalls'
cp first out
whole=$(column 'first picture' kB)
cp tiers out
at_most "$(column 'first picture' kB)" "$whole" "kB to the first picture of tiers"
# On a slow one, with less.
"$player" tiers.l4d 0.2 0.05 10 0 > out
expect_text out 'at the end rung [123] of 4$'

# What is no stream, or a damaged one, ends with a message.
head -c 100000 /dev/zero > zero
if "$player" zero > out 2> err; then die "zeros play"; fi
expect_text err 'L4D_CAUSE_NOT_L4D'
if "$player" > out 2> err; then die "no file plays"; fi
expect_text err '^usage'

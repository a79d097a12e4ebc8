#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: build.sh TOOL PLAYER OUT [GAUSSIANS]
# Makes a gallery for any web server in OUT: the player of the folder PLAYER, scenes of so many Gaussians (200k) that
# the tool makes, those that ./dev web --site --blender and ./dev demo --train have trained, where they are there, and
# the statues of L4D_DATA_DIR (../shared/data), where they are.
set -euo pipefail
tool=$1 player=$2 out=$3 gaussians=${4:-200k}
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
data=${L4D_DATA_DIR:-$root/../shared/data}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir -p "$out"
cp "$player"/{player.js,worker.js,sort-worker.js,l4d.wasm} "$out"
: >"$work/cards"
ours='Licence: Apache-2.0, as l4dcodec'

# card NAME TITLE TEXT LICENCE [ATTRIBUTES]: of the stream OUT/NAME.l4d, whose picture shows before it plays.
card() {
  local facts line attributes=${5:-'playback="auto"'}
  "$tool" render "$out/$1.l4d" --size 960x540 -q -f -o "$out/$1.png"
  # A scene without times and motions stands still: it has a duration, which says nothing.
  facts=$("$tool" info "$out/$1.l4d" --json | python3 -c 'import json, sys
i = json.load(sys.stdin)
moves = any(i["sections"][name] for name in ("mean_t", "rotor_temporal"))
lasts = "%.3g s" % i["duration_s"] if moves else "stands still"
print("%.1f MB, %s, %.0f thousand Gaussians" % (i["file_bytes"] / 1e6, lasts, i["num_gaussians"] / 1e3))')
  line="&lt;l4d-player src=\"$1.l4d\" poster=\"$1.png\" $attributes&gt;&lt;/l4d-player&gt;"
  cat >>"$work/cards" <<HTML
  <article>
    <l4d-player src="$1.l4d" poster="$1.png" loading="lazy" $attributes aria-label="$2"></l4d-player>
    <h2>$2</h2>
    <p>$3</p>
    <p class="facts">$facts. $4.</p>
    <div class="line"><pre><code>$line</code></pre><button type="button">Copy</button></div>
  </article>
HTML
  echo "$1: $facts"
}
# made NAME TITLE TEXT: a scene that synth makes.
made() {
  "$tool" synth --scene "$1" --seconds 8 -n "$gaussians" -q -o "$work/$1.ply"
  "$tool" encode "$work/$1.ply" --tiers 0.15,0.5 -q -f -o "$out/$1.l4d" # a coarse picture comes first
  card "$@" "$ours"
}
# statue NAME TITLE TEXT: one that stands still, and so turns by itself and has no timeline.
statue() {
  "$tool" encode "$data/statues/$1.ply" -q -f -o "$out/$1.l4d"
  card "$@" 'Licence: <a href="statues-licence.txt">MIT</a>, of the examples of
      <a href="https://github.com/playcanvas/web-components">playcanvas/web-components</a>' 'controls="none" auto-rotate'
}
made square "A market square at dusk" "A carousel turns, a fountain plays, people walk: each kind of motion that the format has."
made room "A room in the evening" "A fire, a fan, the pendulum of a clock, a chair that rocks, a cat."
# trained NAME FOLDER TITLE TEXT: what a training has left in FOLDER of build.
trained() {
  [[ -e $root/build/$2/run/scene.l4d ]] || return 0
  cp "$root/build/$2/run/scene.l4d" "$out/$1.l4d"
  card "$1" "$3" "$4" "$ours"
}
trained railway railway "A toy railway, trained from images" \
  "A script models it in Blender, 14 cameras see it, and 5,000 steps of training on a processor make the scene."
trained trained demo-train "The square, trained from images" "What 100 seconds of training on a processor make of 15 cameras."
if [[ -e $data/statues/angel.ply && -e $data/statues/trumpet.ply ]]; then
  cp "$root/web/site/statues-licence.txt" "$out"
  statue angel "An angel of marble" "A statue on a plinth, captured from all sides; it turns by itself."
  statue trumpet "A player of the trumpet, of bronze" "Another one: dark metal, with the light of the hall on it."
else
  echo "the statues are left out: no $data/statues with angel.ply and trumpet.ply"
fi
python3 - "$root/web/site/index.html" "$work/cards" >"$out/index.html" <<'PYTHON'
import pathlib, sys
print(pathlib.Path(sys.argv[1]).read_text().replace("@cards@", pathlib.Path(sys.argv[2]).read_text().rstrip()), end="")
PYTHON

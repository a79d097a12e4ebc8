#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: build.sh TOOL PLAYER OUT [GAUSSIANS]
# Makes a gallery for any web server in OUT: the player of the folder PLAYER, scenes of so many Gaussians (200k) that
# the tool makes, and the one that ./dev demo --train has trained, where it is there.
set -euo pipefail
tool=$1 player=$2 out=$3 gaussians=${4:-200k}
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir -p "$out"
cp "$player"/{player.js,worker.js,sort-worker.js,l4d.wasm} "$out"
: >"$work/cards"

# card NAME TITLE TEXT: of the stream OUT/NAME.l4d, whose picture shows before it plays.
card() {
  local facts line
  "$tool" render "$out/$1.l4d" --size 960x540 -q -f -o "$out/$1.png"
  facts=$("$tool" info "$out/$1.l4d" --json | python3 -c 'import json, sys
i = json.load(sys.stdin)
print("%.1f MB, %.3g s, %d thousand Gaussians" % (i["file_bytes"] / 1e6, i["duration_s"], i["num_gaussians"] / 1e3))')
  line="&lt;l4d-player src=\"$1.l4d\" poster=\"$1.png\" playback=\"auto\"&gt;&lt;/l4d-player&gt;"
  cat >>"$work/cards" <<HTML
  <article>
    <l4d-player src="$1.l4d" poster="$1.png" loading="lazy" playback="auto" aria-label="$2"></l4d-player>
    <h2>$2</h2>
    <p>$3 $facts.</p>
    <div class="line"><pre><code>$line</code></pre><button type="button">Copy</button></div>
  </article>
HTML
  echo "$1: $facts"
}
# made NAME TITLE TEXT: a scene that synth makes.
made() {
  "$tool" synth --scene "$1" --seconds 8 -n "$gaussians" -q -o "$work/$1.ply"
  "$tool" encode "$work/$1.ply" --tiers 0.15,0.5 -q -f -o "$out/$1.l4d" # a coarse picture comes first
  card "$@"
}
made square "A market square at dusk" "A carousel turns, a fountain plays, people walk: each kind of motion that the format has."
made room "A room in the evening" "A fire, a fan, the pendulum of a clock, a chair that rocks, a cat."
trained=$root/build/demo-train/run/scene.l4d
if [[ -e $trained ]]; then
  cp "$trained" "$out/trained.l4d"
  card trained "The square, trained from images" "What 100 seconds of training on a processor make of 15 cameras."
fi
python3 - "$root/web/site/index.html" "$work/cards" >"$out/index.html" <<'PYTHON'
import pathlib, sys
print(pathlib.Path(sys.argv[1]).read_text().replace("@cards@", pathlib.Path(sys.argv[2]).read_text().rstrip()), end="")
PYTHON

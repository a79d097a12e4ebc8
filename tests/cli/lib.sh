# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# What the test scripts share. Each runs in an empty folder, under -euo pipefail.

die() {
  echo "  $*" >&2
  exit 1
}

skip() {
  echo "  SKIPPED: $*" >&2
  exit 77
}

l4d() { "$L4DCODEC" "$@"; }

# wait_for WHAT COMMAND...: until the command succeeds. Long enough for a machine that has much else to do.
wait_for() {
  local what=$1 end=$((SECONDS + 120))
  shift
  until "$@"; do
    [ "$SECONDS" -lt "$end" ] || die "still not after 120 s: $what"
    sleep 0.05
  done
}
has_ended() { ! kill -0 "$1" 2> /dev/null; }

# expect STATUS ARGUMENTS...: runs the tool, keeps stdout in `out` and stderr in `err`.
expect() {
  local want=$1 status=0
  shift
  l4d "$@" > out 2> err || status=$?
  if [ "$status" -ne "$want" ]; then
    cat out err >&2
    die "l4dcodec $*: exit status $status, not $want"
  fi
}

# expect_text FILE PATTERN: an extended regular expression that some line matches.
expect_text() {
  grep -Eq -- "$2" "$1" || {
    cat "$1" >&2
    die "$1: nothing matches $2"
  }
}

expect_empty() {
  [ ! -s "$1" ] || {
    cat "$1" >&2
    die "$1 is not empty"
  }
}

expect_equal() {
  [ "$1" = "$2" ] || die "'$1' is not '$2'"
}

expect_missing() {
  local name
  for name in "$@"; do
    [ ! -e "$name" ] || die "$name exists"
  done
}

# json FILE EXPRESSION: value of a Python expression of the document d.
json() {
  "$PYTHON" -c 'import json, sys
d = json.load(open(sys.argv[1]))
print(eval(sys.argv[2]))' "$1" "$2"
}

# expect_json FILE EXPRESSION: a Python expression of the document d that must be true.
expect_json() {
  [ "$(json "$1" "bool($2)")" = True ] || {
    cat "$1" >&2
    die "$1: not true: $2"
  }
}

# expect_document STATUS ARGUMENTS...: as expect, with --json; stdout must be one document that fits
# its schema and knows no key that the schema does not, and stderr must be empty.
expect_document() {
  local want=$1
  shift
  expect "$want" "$@" --json
  expect_empty err
  "$PYTHON" "$ROOT/tests/cli/check_schema.py" "$ROOT/docs/schema" out || die "l4dcodec $* --json"
}

# A scene of N Gaussians (default 3000) with every effect.
make_scene() {
  l4d synth --scene cloud -q -n "${2:-3000}" --seconds 2 --fps 30 --seed 7 -o "$1"
}

# An 8-bit RGB PNG of this size: expect_png FILE WIDTH HEIGHT.
expect_png() {
  "$PYTHON" -c 'import struct, sys
data = open(sys.argv[1], "rb").read()
assert data[:8] == b"\x89PNG\r\n\x1a\n" and data[12:16] == b"IHDR", "no PNG"
size = struct.unpack(">IIBB", data[16:26])
assert size == (int(sys.argv[2]), int(sys.argv[3]), 8, 2), size' "$@" || die "$1"
}

# cameras.json for scenes of make_scene: make_cameras FILE [FPS]. Cameras 0 and 2 are for testing, 1 and 3
# for training, around the vertical axis; camera k names the video camk.mp4.
make_cameras() {
  "$PYTHON" -c 'import json, math, sys
cameras = []
for k in range(4):
    c, s = math.cos(k * math.pi / 2), math.sin(k * math.pi / 2)
    cameras.append({"id": k, "split": "test" if k % 2 == 0 else "train", "video": "cam%d.mp4" % k,
                    "K": [[90, 0, 48], [0, 90, 32], [0, 0, 1]],
                    "w2c": [[c, 0, s, 0], [0, 1, 0, 0], [-s, 0, c, 8], [0, 0, 0, 1]]})
json.dump({"fps": float(sys.argv[2]), "width": 96, "height": 64, "frames": 60, "cameras": cameras},
          open(sys.argv[1], "w"))' "$1" "${2:-30}"
}

need_ffmpeg() {
  command -v ffmpeg > /dev/null || skip "no ffmpeg"
}

need_data() {
  [ -e "$DATA/$1" ] || skip "no $1 in $DATA"
}

need_server() {
  command -v curl > /dev/null || skip "no curl"
  if l4d serve . --port 70000 2> err; then die "no port"; fi
  ! grep -q "no HTTP server" err || skip "the tool has no HTTP server (./dev setup web)"
}

# has_player: whether `view` works; says so where it does not.
has_player() {
  if l4d view missing.l4d --no-browser 2> err; then die "no such file"; fi
  ! grep -q 'not in this build' err || {
    echo "view is not tested: the tool was built without the player (./dev web)"
    return 1
  }
}

# start_server VERB ARGUMENTS...: leaves the address in `url` and the process in `server`, which ends with the script.
server=
says_address() { [ -s address ] || has_ended "$server"; }
start_server() {
  trap '[ -z "$server" ] || kill "$server" 2> /dev/null || true' EXIT
  rm -f address  # what is there would be read before the process behind `&` empties it
  "$L4DCODEC" "$@" > address 2> err &
  server=$!
  wait_for "an address of l4dcodec $*" says_address
  url=$(head -1 address)
  case $url in
    http://127.0.0.1:*/????????????????????????????????/) ;;
    *) cat err >&2 && die "address '$url'" ;;
  esac
}
end_server() {
  kill "$server"
  wait "$server" || die "exit status $?"
  server=
}

# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# view where this program draws: in a build without the player, of scenes that are no streams, with --pictures.
need_server
url=  # start_server sets it
[ -x "$(command -v "$PYTHON")" ] || skip "no python"
make_scene s.ply 400
expect 0 encode s.ply -o a.l4d --estimate
mkdir folder
cp a.l4d folder

# get PATH: the status in `status`, the body in `body`.
get() { status=$(curl -s --path-as-is --max-time 120 -D headers -o body -w '%{http_code}' "${url%/}$1"); }
gets() {
  get "$1"
  expect_equal "$status" 200
}
# pixels PNG: those of an image of 8 bits a channel, as bytes.
pixels() {
  "$PYTHON" -c 'import struct, sys, zlib
data, at, packed = open(sys.argv[1], "rb").read(), 8, b""
width, height = struct.unpack(">II", data[16:24])
while at < len(data):
    n, = struct.unpack(">I", data[at:at + 4])
    if data[at + 4:at + 8] == b"IDAT": packed += data[at + 8:at + 8 + n]
    at += 12 + n
raw, before, row = zlib.decompress(packed), bytearray(3 * width), 3 * width + 1
for y in range(height):
    kind, line = raw[y * row], bytearray(raw[y * row + 1:(y + 1) * row])
    for x in range(3 * width):
        a, b, c = (line[x - 3] if x > 2 else 0), before[x], (before[x - 3] if x > 2 else 0)
        p = min((abs(b - c), 0, a), (abs(a - c), 1, b), (abs(a + b - 2 * c), 2, c))[2]
        line[x] = line[x] + (0, a, b, (a + b) // 2, p)[kind] & 255
    sys.stdout.buffer.write(line)
    before = line' "$1"
}

start_server view a.l4d --pictures --no-browser
gets /
expect_text body '<canvas'
expect_text body 'src="/[0-9a-f]*/.picture/page.js"'
expect_text headers "^Content-Security-Policy: default-src .none.; script-src .self."
gets /.picture/page.js
expect_text body 'scene.json'
gets /.picture/scene.json
expect_json body 'd["name"] == "a.l4d" and d["begin"] == 0 and d["end"] == 2'
# A picture is that of render.
gets /.picture/64x48/1.25/0/0/1
expect_png body 64 48
expect_text headers '^Content-Type: image/png'
expect 0 render a.l4d --time 1.25 --size 64x48 -o rendered.png
pixels body > got
pixels rendered.png > wanted
cmp got wanted || die "not the picture of render"
[ "$(sort -u got | wc -c)" -gt 100 ] || die "nothing in the picture"
for other in 64x48/0.5/0/0/1 64x48/1.25/1/0/1 64x48/1.25/0/0.5/1 64x48/1.25/0/0/3; do
  gets "/.picture/$other"
  pixels body > other
  ! cmp -s other got || die "the picture of $other"
done
gets /.picture/64x48/1e300/0/-9/1  # the last instant, short of the pole
for wrong in 8x48/1/0/0/1 64x99999/1/0/0/1 -64x48/1/0/0/1 64x48/nan/0/0/1 64x48/1/inf/0/1 64x48/1/0/0/0 64x48/1/0/0/1/ \
  64x48/1/0/0 64x48/1/0/0/1.png ../a.l4d .. ''; do
  get "/.picture/$wrong"
  expect_equal "$status" 404
done
# There is nothing else.
get /a.l4d
expect_equal "$status" 404
end_server

start_server view s.ply --no-browser
gets /.picture/64x48/1.25/0/0/1
expect_png body 64 48
end_server

# From a pipe, which & would take away from start_server.
rm -f address
"$L4DCODEC" view - --pictures --no-browser < a.l4d > address 2> err &
# shellcheck disable=SC2034  # end_server reads it
server=$!
wait_for "an address of view -" says_address
url=$(head -1 address)
gets /.picture/64x48/1.25/0/0/1
expect_png body 64 48
end_server
if has_player; then
  status=0
  l4d view - --no-browser < a.l4d 2> err || status=$?
  expect_equal "$status" 3
fi

expect 3 view missing.l4d --pictures --no-browser
expect 2 view folder --pictures --no-browser
expect_text err 'one scene'
head -c 30 a.l4d > cut.l4d  # within the first header
status=0
l4d view cut.l4d --no-browser 2> err || status=$?
[ "$status" -gt 2 ] || die "a stream that is cut: status $status"

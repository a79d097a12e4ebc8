# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# --limit-memory: what a small stream may make a command hold, the process measured from outside.
make_scene s.ply 30000

# Gaussians that each cover the picture, in a stream of little more than what tells them apart.
"$PYTHON" - <<'PY'
import struct
data = open("s.ply", "rb").read()
end = data.index(b"end_header\n") + len(b"end_header\n")
header = data[:end].decode()
names = [line.split()[2] for line in header.splitlines() if line.startswith("property")]
assert all(line.split()[1] == "float" for line in header.splitlines() if line.startswith("property"))
width = len(names)
rows = (len(data) - end) // (4 * width)
out = bytearray(data[:end])
for i in range(rows):
    row = dict(zip(names, struct.unpack_from("<%df" % width, data, end + 4 * width * i)))
    for k in range(width):
        name = names[k]
        if name.startswith("f_rest"): row[name] = 0.0
    row.update({"scale_0": 3.0, "scale_1": 3.0, "scale_2": 3.0, "scale_3": 8.0, "opacity": -4.0,
                "x": 0.01 * (i % 7), "y": 0.0, "z": 0.0})
    for k in range(8): row["rotor_%d" % k] = 1.0 if k == 0 else 0.0
    out += struct.pack("<%df" % width, *(row[n] for n in names))
open("veils.ply", "wb").write(out)
PY
expect 0 encode veils.ply -o veils.l4d

# peak STATUS ARGUMENTS..: MiB that the tool held at most.
peak() {
  "$PYTHON" - "$@" <<'PY'
import os, resource, subprocess, sys
code = subprocess.run([os.environ["L4DCODEC"]] + sys.argv[2:], stdout=subprocess.DEVNULL,
                      stderr=open("err", "w")).returncode
assert code == int(sys.argv[1]), (code, open("err").read())
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss // 1024)
PY
}
export L4DCODEC
expect_below() {
  [ "$1" -lt "$2" ] || die "$1 MiB held, not below $2"
}
base=$(peak 0 info s.l4d 2>/dev/null || peak 0 version)

expect_below "$(peak 0 render veils.l4d --size 1280x720 -o whole.png --limit-memory 4GiB)" \
  $((base + 450))
expect_below "$(peak 0 render veils.l4d --size 1280x720 -o batches.png --limit-memory 96MiB)" \
  $((base + 96))
cmp whole.png batches.png
# Where it does not fit, that is said before it is taken.
expect_below "$(peak 6 render veils.l4d --size 1280x720 -o none.png --limit-memory 16MiB)" \
  $((base + 16))
expect_missing none.png
# An image alone is too much.
expect_below "$(peak 6 render veils.l4d --size 8000x8000 -o none.png --limit-memory 96MiB)" \
  $((base + 96))
expect_text err 'an image needs'

# Of cameras larger than that, importance holds nothing for each pixel.
"$PYTHON" -c 'import json
pose = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 5], [0, 0, 0, 1]]
camera = {"id": 0, "K": [[2e3, 0, 2048], [0, 2e3, 2048], [0, 0, 1]], "w2c": pose}
json.dump({"width": 4096, "height": 4096, "frames": 1, "cameras": [camera]}, open("large.json", "w"))'
expect_below "$(peak 0 sensitivity s.ply -o large.ply --cameras large.json --limit-memory 50MiB)" \
  $((base + 50))
# An encode looks at images of theirs, too.
expect_below "$(peak 6 encode s.ply -o none.l4d --cameras large.json --limit-memory 50MiB)" \
  $((base + 50))
expect_text err 'an image needs'
expect_missing none.l4d

# What a session keeps: 30,000 Gaussians of some 400 bytes.
expect_below "$(peak 6 encode --live veils.ply -o none.l4d --limit-memory 64MiB)" $((base + 64))
expect_text err 'the session would keep 30000 Gaussians of the piece and 0 of those before, which need'
expect_missing none.l4d
expect 0 encode --live veils.ply -o live.l4d --limit-memory 128MiB

# What is decoded counts, not only what decoding takes: 30,000 Gaussians of 264 bytes.
expect_below "$(peak 6 decode veils.l4d -o none.ply --limit-memory 12MiB)" $((base + 12))
expect_text err 'the decoded scene needs'
expect_below "$(peak 6 slice veils.l4d --time 0.5 -o none.ply --limit-memory 8MB)" $((base + 8))
expect_below "$(peak 0 decode veils.l4d -o all.ply --limit-memory 64MiB)" $((base + 64))
expect_below "$(peak 6 compare veils.l4d veils.l4d --limit-memory 24MiB)" $((base + 24))
# So does what the writers of instants make.
if l4d slice veils.l4d --time 0.5 -o any.sog -q; then
  expect_below "$(peak 6 slice veils.l4d --time 0.5 -o none.sog --limit-memory 32MB)" $((base + 32))
  expect_text err 'none.sog.* as SOG needs'
  expect_missing none.sog
  expect_below "$(peak 0 slice veils.l4d --time 0.5 -o large.sog --limit-memory 160MB)" $((base + 160))
else
  l4d slice veils.l4d --time 0.5 -o any.sog 2> err || true
  expect_text err WebP
fi
# Who is refused a share of the limit is told of what it is a share.
expect 6 render veils.l4d -o none.png --limit-memory 1MB
expect_text err 'the limit is 500000, a share of --limit-memory 1MB$'
expect_missing none.ply

# What the machine does not have: one message, wherever in the tool that is noticed.
"$PYTHON" - <<'PY'
import os, resource, subprocess
def run(kib):
    limit = lambda: resource.setrlimit(resource.RLIMIT_AS, (1024 * kib, 1024 * kib))
    return subprocess.run([os.environ["L4DCODEC"], "decode", "veils.l4d", "-o", "little.ply", "-f", "-q"], preexec_fn=limit,
                          stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
# From where the loader can load all libraries, in steps until the command succeeds.
kib = 8 << 10
while (done := run(kib)).returncode == 127 or done.returncode < 0:
    kib += 128
refused = 0
while done.returncode != 0:
    assert done.returncode == 7 and "memory" in done.stderr, (kib, done.returncode, done.stderr)
    refused += 1
    kib += max(128, kib // 64)
    done = run(kib)
assert refused > 2, refused
PY

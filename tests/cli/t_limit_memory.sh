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
expect_missing none.ply

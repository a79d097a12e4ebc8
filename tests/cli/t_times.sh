# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# A day counted from 1970: all commands have one clock, and no time is lost in float32.
"$PYTHON" - > day.ply <<'END'
import struct, sys
begin, n = 1763800000.25, 400
names = ["x", "y", "z", "t", *(f"scale_{k}" for k in range(4)), *(f"rotor_{k}" for k in range(8)),
         "opacity", *(f"f_dc_{k}" for k in range(3))]
out = sys.stdout.buffer
out.write(("ply\nformat binary_little_endian 1.0\ncomment l4d_ply 1\ncomment time_unit seconds\n"
           f"comment time_begin {begin}\ncomment time_end {begin + 86400}\ncomment fps 30\n"
           f"element vertex {n}\n" + "".join(
               f"property {'double' if p == 't' else 'float'} {p}\n" for p in names) +
           "end_header\n").encode())
for i in range(n):
    event = i % 2 == 0
    t = begin + 86400 * (i + 0.37) / n if event else begin + 43200
    out.write(struct.pack("<3fd4f8f4f", i % 20, i // 20, 0, t, -2, -2, -2,
                          -3.5 if event else 14, 1, 0, 0, 0, 0, 0, 0, 0, 2.0, 0.5, 0.2, 0.1))
END
# The largest difference of the times of events, in order.
events() {
  "$PYTHON" -c 'import struct, sys
def times(name):
    data = open(name, "rb").read()
    at = data.index(b"end_header\n") + 11
    rows = struct.iter_unpack("<3fd4f8f4f", data[at:])
    return sorted(r[3] for r in rows if r[7] < 0)
a, b = map(times, sys.argv[1:])
assert len(a) == len(b) == 200
print(max(abs(x - y) for x, y in zip(a, b)))' "$@"
}
# Event 200 is at its brightest then.
at=1763843280.17

for preset in lossless archive default indexed; do
  expect 0 encode day.ply -o day.l4d --preset "$preset" -f
  expect_document 0 validate day.l4d
  expect_document 0 info day.l4d
  expect_json out 'd["time_begin"] == 1763800000.25'
  expect 0 info day.l4d --time "$at"
  expect_text out "from 1763800000.250 s"
  expect_text out "seek to 1763843280.170 s"
  expect_document 0 slice day.l4d --time "$at" -o now.ply -f
  expect_json out 'd["frames"][0]["gaussians"] == 201'
  expect_document 0 slice day.l4d --time 1763843000 -o before.ply -f
  expect_json out 'd["frames"][0]["gaussians"] == 200'
  expect_document 0 decode day.l4d -o again.ply -f
  grep -aq "property double t" again.ply || die "$preset: times became float"
  off=$(events day.ply again.ply)
  "$PYTHON" -c "import sys; sys.exit(not $off <= 0.05 * 0.0302)" || die "$preset: off by $off s"
done
expect 0 encode day.ply -o day.l4d --preset lossless -f
expect_document 0 compare day.ply day.l4d --exact
expect_json out 'd["identical"]'

# Float32 holds these times to a thousandth of a frame, but not of so brief events.
"$PYTHON" - day.ply << 'END' > brief.ply
import struct, sys
head, body = open(sys.argv[1], "rb").read().split(b"end_header\n")
sys.stdout.buffer.write(head.replace(b"1763800000.25", b"0").replace(b"1763886400.25", b"2") + b"end_header\n")
for i, row in enumerate(struct.iter_unpack("<3fd4f8f4f", body)):
    event = i % 2 == 0
    sys.stdout.buffer.write(struct.pack("<3fd4f8f4f", *row[:3], 1.8 * i / 400 + 0.1, *row[4:7],
                                        -12 if event else 14, *row[8:]))
END
expect 0 encode brief.ply -o brief.l4d --preset archive
expect_document 0 info brief.l4d
stated=$(json out 'd["stated_errors"]["mean_t_sigmas"]')
expect 0 decode brief.l4d -o again.ply -f
off=$(events brief.ply again.ply)
"$PYTHON" -c "import math, sys; sys.exit(not $off <= 1.001 * $stated * math.exp(-12))" ||
  die "brief events are off by $off s"

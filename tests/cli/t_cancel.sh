# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# SIGINT: exit status 130, no temporary, no output; progress only where it was asked for.
mkdir d
make_scene d/s.ply 60k

# Commands in the background of a script ignore SIGINT, so a small program sends it.
interrupt() {
  "$PYTHON" - "$L4DCODEC" "$@" << 'END'
import json
import signal
import subprocess
import sys

signal.signal(signal.SIGINT, signal.default_int_handler)
process = subprocess.Popen(sys.argv[1:] + ["--progress", "json"], stdout=subprocess.PIPE,
                           stderr=subprocess.PIPE, text=True)
# The first line of progress that counts something: the command is in the middle of its work.
for line in process.stderr:
    now = json.loads(line) if line.startswith("{") else {"verb": "a note"}
    if now["verb"] in ("encode", "sensitivity") or now["verb"] == "render" and now["done"] > 0:
        break
process.send_signal(signal.SIGINT)
out, err = process.communicate(timeout=300)
open("out", "w").write(out)
print(process.returncode)
END
}
expect_equal "$(interrupt encode d/s.ply -o d/s.l4d --set kmeans-iterations=1000 --set kmeans-sample=1000)" 130
expect_empty out
expect_equal "$(cd d && echo *)" s.ply
expect_equal "$(interrupt encode d/s.ply -o d/s.l4d --json --set kmeans-iterations=1000)" 130
expect_json out 'd["error"]["code"] == 130 and d["error"]["name"] == "L4D_ERR_CANCELLED"'
expect_equal "$(cd d && echo *)" s.ply

# One large view: the signal comes while it is drawn, and the command does not end it first.
"$PYTHON" -c 'import json
pose = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 9], [0, 0, 0, 1]]
cameras = [{"id": k, "K": [[4e3, 0, 4096], [0, 4e3, 4096], [0, 0, 1]], "w2c": pose} for k in range(3)]
json.dump({"width": 8192, "height": 8192, "frames": 1, "cameras": cameras}, open("large.json", "w"))'
expect_equal "$(interrupt sensitivity d/s.ply --cameras large.json --all-views -o d/w.ply)" 130
expect_equal "$(cd d && echo *)" s.ply

# Of a sequence of images those that are done stay, and each is whole.
expect_equal "$(interrupt render d/s.ply --size 640x480 -o d/f_%04d.png)" 130
"$PYTHON" -c 'import os
files = sorted(os.listdir("d"))
assert files[0] == "f_0000.png" and files[-1] == "s.ply" and len(files) < 61, files
for name in files[:-1]:
    data = open("d/" + name, "rb").read()
    assert data[:4] == b"\x89PNG" and data[-8:-4] == b"IEND", name'
rm d/f_*.png

# stderr is no terminal here: nothing by default, lines when asked for.
make_scene small.ply 2000
expect 0 encode small.ply -o a.l4d
expect_empty err
expect 0 encode small.ply -o b.l4d --progress plain
expect_text err '^encode: '
expect 0 encode small.ply -o c.l4d --progress json
"$PYTHON" -c 'import json
lines = [json.loads(line) for line in open("err")]
assert any(l["verb"] == "encode" and l["total"] > 0 for l in lines)
assert all(0 <= l["done"] <= l["total"] for l in lines)'
cmp a.l4d b.l4d
cmp a.l4d c.l4d

# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# What is written has the right permissions, and what is not finished leaves nothing behind.
make_scene s.ply 2000
umask 022
mkdir tmp
export TMPDIR=$PWD/tmp

mode() { stat -c %a "$1"; }

# --force does not open what was closed.
expect 0 encode s.ply -o s.l4d --preset lossless --order s.order
expect_equal "$(mode s.l4d) $(mode s.order)" '644 644'
for name in s.l4d s.order d.ply f.ply w.ply i.svg r.png c.png; do
  [ -e $name ] || : > $name
  chmod 600 $name
done
expect 0 encode s.ply -o s.l4d --preset lossless --order s.order -f
expect 0 decode s.l4d -o d.ply -f
expect 0 slice s.l4d --time 1 -o f.ply -f
expect 0 info s.l4d --plot i.svg -f
expect 0 render s.l4d --size 32x16 -o r.png -f
expect 0 sensitivity s.ply --orbit 2 --size 32x16 --frames 0 -o w.ply -f
expect 0 compare s.ply s.l4d --orbit 1 --size 32x16 --frames 0 --side-by-side c.png -f
for name in s.l4d s.order d.ply f.ply w.ply i.svg r.png c.png; do
  expect_equal "$name $(mode $name)" "$name 600"
done
if command -v ffmpeg > /dev/null; then
  : > v.mp4
  chmod 600 v.mp4
  expect 0 render s.l4d --size 32x16 --range 0:0.2 -o v.mp4 -f
  expect_equal "$(mode v.mp4)" 600
fi

# A reader that goes away: status 3, and nothing is left in the folder of temporary files.
expect_equal "$(ls -A tmp)" ""
status=0
{ l4d encode s.ply -o - --preset lossless 2> err || echo $? > status; } | head -c 100 > /dev/null
expect_equal "$(cat status)" 3
expect_text err '^l4dcodec: stdout: cannot write: Broken pipe$'
expect_equal "$(ls -A tmp)" ""

# While stdout is spooled, nobody can read it, and SIGKILL leaves nothing either.
"$PYTHON" - "$L4DCODEC" << 'END'
import os
import subprocess
import sys
process = subprocess.Popen([sys.argv[1], "encode", "s.ply", "-o", "-", "--progress", "json", "--set",
                            "kmeans-iterations=50"], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
process.stderr.readline()
assert os.listdir("tmp") == [], os.listdir("tmp")
process.kill()
process.wait()
assert os.listdir("tmp") == [], os.listdir("tmp")
END

# SIGKILL leaves a temporary file; the next run of that name removes it. The first one waits in the middle of its work:
# its progress goes to a pipe that has room for one line.
mkdir killed
"$PYTHON" - "$L4DCODEC" << 'END'
import fcntl
import os
import subprocess
import sys
import time
unread, full = os.pipe2(os.O_DIRECT)  # each line takes a page of its own
fcntl.fcntl(full, 1031, 4096)  # F_SETPIPE_SZ, which Python has from 3.10 on
process = subprocess.Popen([sys.argv[1], "encode", "s.ply", "-o", "killed/s.l4d", "--estimate", "--progress", "json"],
                           stderr=full)
end = time.monotonic() + 120
while not os.listdir("killed"):
    assert process.poll() is None and time.monotonic() < end, "no temporary file"
    time.sleep(0.05)
process.kill()
process.wait()
END
expect_equal "$(ls killed)" s.l4d.l4dtmp0
expect 0 encode s.ply -o killed/s.l4d
expect_equal "$(ls killed)" s.l4d

# A link that leads nowhere is not replaced, and followed only with --force.
mkdir there
ln -s there/target.l4d link.l4d
expect 3 encode s.ply -o link.l4d
expect_text err 'exists already'
expect_missing there/target.l4d
expect 0 encode s.ply -o link.l4d --preset lossless -f
[ -L link.l4d ] || die "the link was replaced"
cmp there/target.l4d s.l4d
ln -s round round
expect 3 encode s.ply -o round -f
[ -L round ] || die "the link was replaced"

# Where it cannot be written is told before the work.
expect 3 encode s.ply --cameras nowhere.json -o x.l4d
expect_text err 'nowhere.json'
expect 3 encode s.ply -o nowhere/x.l4d --weights nowhere.ply
expect_text err 'nowhere.ply'

# Streams and descriptors that are open already.
l4d encode s.ply -o /dev/stdout --preset lossless 2> err | cmp - s.l4d
expect_text err 'bits per Gaussian'
expect 2 encode s.ply -o /dev/stdout --json
expect 2 encode s.ply -o x.l4d --order /dev/stdout
l4d encode s.ply -o /dev/fd/7 --preset lossless -q 7> seven
cmp seven s.l4d
printf 'before' > seven
l4d encode s.ply -o /dev/fd/7 --preset lossless -q 7>> seven
cat <(printf 'before') s.l4d | cmp - seven

# Closed standard streams are not taken by files that are opened.
status=0
l4d encode s.ply -o x.l4d --preset lossless -f >&- 2> err || status=$?
expect_equal "$status" 3
cmp x.l4d s.l4d
l4d encode s.ply -o x.l4d --preset lossless -f -q >&- 2>&- <&-
cmp x.l4d s.l4d
status=0
l4d info - <&- > out 2> err || status=$?
expect_equal "$status" 3
for arguments in --help 'encode --help' help version; do
  status=0
  # shellcheck disable=SC2086
  l4d $arguments > /dev/full 2> err || status=$?
  expect_equal "$status" 3
  expect_text err '^l4dcodec: stdout: cannot write'
done

# Named pipes.
mkfifo pipe
expect 3 info pipe
expect 3 encode s.ply -o y.l4d --weights pipe
expect_text err 'nobody writes'
cat s.l4d > pipe &
expect 3 info pipe
cat pipe > /dev/null
wait
expect 0 sensitivity s.ply --orbit 2 --size 32x16 --frames 0 -o weights.ply
expect 0 encode s.ply -o y.l4d --weights <(cat weights.ply) -f
cat pipe > piped &
expect 0 encode s.ply -o pipe --preset lossless
wait
cmp piped s.l4d
[ -p pipe ] || die "the pipe was replaced"

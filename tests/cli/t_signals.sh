# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# Signals at many moments of encode and decode: either the command is cancelled and everything is as it
# was, or the signal came too late and the output is whole.
make_scene s.ply 20k
cp s.ply source.ply
expect 0 encode s.ply -o whole.l4d --set kmeans-iterations=20
expect 0 decode whole.l4d -o whole.ply
mkdir d
printf 'what was there before' > before

# Commands in the background of a script ignore SIGINT, so a small program sends it: the moments are
# lines of progress and a delay after each. However late it is, the command is not far ahead: it waits where a line
# before its last one has not been read. It prints how many of the commands were cancelled.
signals() {
  "$PYTHON" - "$@" << 'END'
import fcntl
import filecmp
import os
import shutil
import signal
import subprocess
import sys
import time

tool, source, whole, name = sys.argv[1:5]
command = sys.argv[5:]
signal.signal(signal.SIGINT, signal.default_int_handler)
cancelled = 0
for moment in range(14):
    output = os.path.join("d", name)
    if moment % 2 == 0:
        shutil.copy("before", output)
    progress, written = os.pipe2(os.O_DIRECT)  # each line takes a page of its own, of which there is one
    fcntl.fcntl(written, 1031, 4096)  # F_SETPIPE_SZ, which Python has from 3.10 on
    process = subprocess.Popen([tool, *command, "-o", output, "--force", "--progress", "json"],
                               stdout=subprocess.PIPE, stderr=written, text=True)
    os.close(written)
    process.stderr = os.fdopen(progress)
    for _ in range(1 + moment // 2):
        if not process.stderr.readline():
            break
    time.sleep(0.004 * moment * (moment % 3))
    process.send_signal(signal.SIGTERM if moment % 4 > 1 else signal.SIGINT)
    out, err = process.communicate(timeout=300)
    where = "moment %d, status %d: %s" % (moment, process.returncode, err)
    left = os.listdir("d")
    if process.returncode == 130:
        cancelled += 1
        assert out == "", where
        assert left == ([name] if moment % 2 == 0 else []), (where, left)
        assert not left or filecmp.cmp(output, "before", shallow=False), where
    else:
        assert process.returncode == 0, where
        assert left == [name] and filecmp.cmp(output, whole, shallow=False), (where, left)
    for old in left:
        os.remove(os.path.join("d", old))
    assert filecmp.cmp(source, source + ".copy", shallow=False), where
print(cancelled)
END
}
cp s.ply s.ply.copy
cp whole.l4d whole.l4d.copy
cancelled=$(signals "$L4DCODEC" s.ply whole.l4d o.l4d encode s.ply --set kmeans-iterations=20)
[ "$cancelled" -ge 5 ] || die "only $cancelled of 14 encodes were cancelled"
# Decoding takes a moment, so that the signal may come too late each time.
signals "$L4DCODEC" whole.l4d whole.ply o.ply decode whole.l4d > /dev/null

# While it waits for the rest of its input a command is surely not done: interrupt_halfway SIGNAL INPUT
# COMMAND...
interrupt_halfway() {
  "$PYTHON" - "$@" << 'END'
import signal
import subprocess
import sys

signal.signal(signal.SIGINT, signal.default_int_handler)
data = open(sys.argv[2], "rb").read()
process = subprocess.Popen(sys.argv[3:], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                           stderr=subprocess.PIPE)
# Far more than a pipe holds: when it is taken, the command has begun.
process.stdin.write(data[:len(data) // 2])
process.stdin.flush()
process.send_signal(getattr(signal, sys.argv[1]))
out = process.stdout.read()
process.stdin.close()
process.wait(timeout=300)
assert out == b"", out
print(process.returncode)
END
}
for signal in SIGINT SIGTERM; do
  cp before d/o
  expect_equal "$(interrupt_halfway $signal whole.l4d "$L4DCODEC" decode - -o d/o --force)" 130
  expect_equal "$(interrupt_halfway $signal s.ply "$L4DCODEC" encode - -o d/o --force)" 130
  expect_equal "$(cd d && echo *)" o
  cmp before d/o
done

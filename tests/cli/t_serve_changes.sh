# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# serve while files are overwritten or grow.
need_server
url=  # start_server sets it

bytes() { "$PYTHON" -c 'import random, sys
sys.stdout.buffer.write(random.Random(sys.argv[1]).randbytes(int(sys.argv[2])))' "$@"; }

# 400 kB take 1.6 s at 2 Mbit/s. What comes is never a mixture, whoever writes while it comes.
mkdir files
start_server serve files --rate 2
# download: into `got` in the background, of which something has come.
download() {
  rm -f got
  curl -s -N --max-time 60 -D headers -o got "${url}a.l4d" &
  client=$!
  for _ in $(seq 600); do
    [ -s got ] && break
    sleep 0.05
  done
}
# is_cut WHAT: what came before another one of the same size is all that came, with a failure.
is_cut() {
  local status=0
  wait "$client" || status=$?
  [ "$status" -ne 0 ] || die "$1: curl takes it for a file"
  grep -q '^HTTP/1.1 200' headers || die "$1: no answer"
  size=$(wc -c < got)
  if [ "$size" -eq 0 ] || [ "$size" -ge 400000 ]; then die "$1: $size bytes"; fi
  head -c "$size" first | cmp - got || die "$1: a mixture"
}
is_whole() {
  wait "$client" || die "$1: curl fails: $?"
  cmp first got || die "$1: other bytes"
}
bytes 1 400000 > first
bytes 2 400000 > second
bytes 2 500000 > longer
restore() {
  cp first files/a.l4d
  touch -d '2001-01-01' files/a.l4d
}
restore && download
dd if=second of=files/a.l4d conv=notrunc status=none
is_cut "overwritten in place"
restore && download
cp longer files/a.l4d
is_cut "overwritten with a longer one"
restore && download
dd if=second of=files/a.l4d bs=1 count=1 conv=notrunc status=none
is_cut "its first byte"
restore && download
truncate -s 1000 files/a.l4d
is_cut "cut off"
# Another file of this name, more at the end, the same bytes, and another time change nothing of what comes.
restore && download
cp second files/new && mv files/new files/a.l4d
is_whole "replaced"
restore && download
for _ in 1 2 3; do
  head -c 1000 second >> files/a.l4d
  sleep 0.2
done
is_whole "it grows"
restore && download
dd if=first of=files/a.l4d conv=notrunc status=none
touch -d '2002-01-01' files/a.l4d
is_whole "written as it was"
# A time to come does not make it slow.
restore && touch -d '2100-01-01' files/a.l4d && download
is_whole "a time to come"
end_server

# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# serve while files are overwritten or grow.
need_server
url=  # start_server sets it

bytes() { "$PYTHON" -c 'import random, sys
sys.stdout.buffer.write(random.Random(sys.argv[1]).randbytes(int(sys.argv[2])))' "$@"; }

# A file is more than sockets and pipes hold, so that a download lasts until all of it has been taken. What comes is
# never a mixture, whoever writes while it comes.
size=32000000
mkdir files
start_server serve files
# download: into `got`, of which only the first bytes are taken; take N: more of them; take_rest: all.
download() {
  exec 3< <(exec curl -s -N --max-time 300 -D headers "${url}a.l4d")
  client=$!
  head -c 1000 <&3 > got
}
take() { head -c "$1" <&3 >> got; }
take_rest() {
  cat <&3 >> got
  exec 3<&-
}
# is_cut WHAT: what came before another one of the same size is all that came, with a failure.
is_cut() {
  local status=0 came
  take_rest
  wait "$client" || status=$?
  [ "$status" -ne 0 ] || die "$1: curl takes it for a file"
  grep -q '^HTTP/1.1 200' headers || die "$1: no answer"
  came=$(wc -c < got)
  if [ "$came" -eq 0 ] || [ "$came" -ge "$size" ]; then die "$1: $came bytes"; fi
  head -c "$came" first | cmp - got || die "$1: a mixture"
}
is_whole() {
  take_rest
  wait "$client" || die "$1: curl fails: $?"
  cmp first got || die "$1: other bytes"
}
bytes 1 $size > first
bytes 2 $size > second
restore() {
  cp first files/a.l4d
  touch -d '2001-01-01' files/a.l4d
}
restore && download
dd if=second of=files/a.l4d bs=1M conv=notrunc status=none
is_cut "overwritten in place"
restore && download
cat second second > files/a.l4d
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
  take 8000000
done
is_whole "it grows"
restore && download
dd if=first of=files/a.l4d bs=1M conv=notrunc status=none
touch -d '2002-01-01' files/a.l4d
is_whole "written as it was"
# A time to come does not make it slow.
restore && touch -d '2100-01-01' files/a.l4d && download
is_whole "a time to come"
end_server

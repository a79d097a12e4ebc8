# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# serve among clients that flood, stall, send garbage or never end: others are answered, and it ends when it is told to.
need_server
mkdir files
head -c 5000 /dev/urandom > files/small.l4d
head -c 60000000 /dev/zero > files/large.l4d
"$PYTHON" "$ROOT/tests/cli/hostile_clients.py" "$L4DCODEC" files || die "hostile clients"

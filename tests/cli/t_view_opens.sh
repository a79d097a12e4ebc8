# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# The address that view gives to other programs.
need_server
url=  # start_server sets it
has_player || skip "no player"
[ -r /proc/net/tcp ] || skip "the system does not say whose connections are"
mkdir files
: > files/later.l4d
# Other programs are not told the token, which everybody could read in the list of processes.
mkdir programs
cat > programs/xdg-open << 'END'
#!/bin/sh
echo "$@" > opened.part
mv opened.part opened
END
chmod +x programs/xdg-open
export PATH=$PWD/programs:$PATH DISPLAY=:0
start_server view files
wait_for "xdg-open" test -e opened
opened=$(cat opened)
token=$(echo "$url" | cut -d/ -f4)
case $opened in
  http://127.0.0.1:*/????????????????????????????????) ;;
  *) die "xdg-open got '$opened'" ;;
esac
case $opened in *"$token"*) die "xdg-open got the token" ;; esac
codes() { curl -s --max-time 120 -o got -w '%{http_code} %{redirect_url}' "$@"; }
# Programs of other users get nothing, and use nothing up.
if [ "$(id -u)" -eq 0 ]; then
  other=$("$PYTHON" - "$opened" << 'END'
import os, sys, urllib.error, urllib.request
"".encode("idna")  # what looks hosts up loads this, from where that user may not read
os.setgroups([])
os.setgid(65534)
os.setuid(65534)
try:
    print(urllib.request.urlopen(sys.argv[1], timeout=120).geturl())
except urllib.error.HTTPError as error:
    print(error.code)
END
  )
  expect_equal "$other" 404
else
  echo "other users are not tried: that takes root"
fi
expect_equal "$(codes "$opened" -H 'Host: evil.example')" "403 "
expect_equal "$(codes "$opened")" "303 $url"
expect_equal "$(codes "$opened")" "404 "
end_server
rm opened
start_server view files --no-browser
end_server
expect_missing opened

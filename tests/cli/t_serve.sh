# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# serve and view: ranges, conditions, lists, what is refused, and an end by a signal.
need_server

make_scene s.ply 3000
mkdir -p files/inner nothing/inner
expect 0 encode s.ply -o files/a.l4d
cp files/a.l4d files/inner/b.l4d
echo secret > outside.txt
echo hidden > files/.hidden
ln -s ../outside.txt files/link.l4d
ln -s a.l4d files/good.l4d
mkfifo files/pipe.l4d
ln -s nowhere.l4d files/dead.l4d
mkdir files/folder.l4d files/empty
# Names that mean something else to a URL, to HTML or to a shell.
odd='100% <b>"&amp;#?;+ é'"'"'.l4d'
cp files/a.l4d "files/$odd"
cp files/a.l4d "files/inner/$odd"
size=$(wc -c < files/a.l4d)

# get PATH CURL_OPTIONS...: status in `status`, headers in `head`, the body in `body`.
get() {
  local path=$1
  shift
  status=$(curl -s --path-as-is --max-time 120 -D headers -o body -w '%{http_code}' "$@" "${url%/}$path")
  tr -d '\r' < headers > head.text
}
expect_status() {
  [ "$status" = "$1" ] || {
    cat head.text >&2
    die "$2: status $status, not $1"
  }
}

start_server serve files
get /a.l4d
expect_status 200 "a file"
cmp body files/a.l4d
tag=$(sed -n 's/^ETag: //p' head.text)
expect_text head.text '^Accept-Ranges: bytes$'
expect_text head.text '^Content-Type: model/l4d$'
expect_text head.text '^X-Content-Type-Options: nosniff$'

# ranged RANGE BEGIN COUNT: a part, with these bytes.
ranged() {
  get /a.l4d -H "Range: bytes=$1"
  expect_status 206 "$1"
  expect_text head.text "^Content-Range: bytes $2-$(($2 + $3 - 1))/$size\$"
  expect_text head.text "^Content-Length: $3\$"
  tail -c +$(($2 + 1)) files/a.l4d > rest
  head -c "$3" rest | cmp - body
}
ranged 0-0 0 1
ranged 0-39 0 40
ranged 100-299 100 200
ranged "$((size - 5))-" $((size - 5)) 5
ranged "-7" $((size - 7)) 7
ranged "-999999999" 0 "$size"
ranged "10-999999999" 10 $((size - 10))
ranged "10-18446744073709551615" 10 $((size - 10))
ranged "10-99999999999999999999999" 10 $((size - 10))
ranged "-99999999999999999999999" 0 "$size"
ranged " , 3-4 ," 3 2
ranged "999999999-,3-4" 3 2
get /a.l4d -H "Range: Bytes=3-4"
expect_status 206 "another case"
# Several are answered with the whole file. What breaks the grammar is no range (RFC 9110, 14.2).
for range in 0-1,5-6 x-y 9-3 - 0x1-2 '1 -' 2-4-6 "0-1 5-6" ","; do
  get /a.l4d -H "Range: bytes=$range"
  expect_status 200 "$range"
  cmp body files/a.l4d
done
get /a.l4d -H "Range: lines=0-1"
expect_status 200 "another unit"
# What is one, and names no byte of the file: the answer says how many there are.
for range in "$size-" "999999999-9999999999" -0 18446744073709551616- 99999999999999999999999-99999999999999999999999 \
  "$size-,$size-"; do
  get /a.l4d -H "Range: bytes=$range"
  expect_status 416 "$range"
  expect_text head.text "^Content-Range: bytes \*/$size\$"
done

# If-Range: a part of the same file only.
get /a.l4d -H "Range: bytes=0-9" -H "If-Range: $tag"
expect_status 206 "the same tag"
for other in '"other"' "W/$tag" 'Wed, 21 Oct 2015 07:28:00 GMT'; do
  get /a.l4d -H "Range: bytes=0-9" -H "If-Range: $other"
  expect_status 200 "If-Range: $other"
done
# If-None-Match: nothing of the same file. It comes before ranges.
for list in "$tag" '*' "W/$tag" "\"a,b\", $tag"; do
  get /a.l4d -H "If-None-Match: $list" -H "Range: bytes=999999999-"
  expect_status 304 "If-None-Match: $list"
  expect_text head.text "^ETag: $tag\$"
  ! grep -q '^Content-Length: 0' head.text || die "304 says that the file is empty"
done
for list in '"other"' "${tag%\"}" 'x'; do
  get /a.l4d -H "If-None-Match: $list"
  expect_status 200 "If-None-Match: $list"
done
# The connection goes on after an answer without a body.
curl -s --max-time 120 -w '%{http_code} %{num_connects}\n' -H "If-None-Match: $tag" "${url}a.l4d" "${url}a.l4d" > codes
expect_equal "$(paste -s -d ' ' codes)" "304 1 304 0"
get /a.l4d -H 'If-Match: "other"'
expect_status 412 "If-Match of another file"
get /a.l4d -H "If-Match: $tag"
expect_status 200 "If-Match"
# A client that caches.
curl -s --max-time 120 --etag-save tag.text -o cached "${url}a.l4d"
curl -s --max-time 120 --etag-compare tag.text -o again -w '%{http_code}' "${url}a.l4d" > code
expect_equal "$(cat code)" 304
touch -d '2001-01-01' files/a.l4d
get /a.l4d -H "Range: bytes=0-9" -H "If-Range: $tag"
expect_status 200 "a changed file"
get /a.l4d -H "If-None-Match: $tag"
expect_status 200 "a changed file that is cached"

# HEAD has the length and no body.
curl -s --max-time 120 -I "${url}a.l4d" | tr -d '\r' > head.text
expect_text head.text '^HTTP/1.1 200'
expect_text head.text "^Content-Length: $size\$"
curl -s --max-time 120 -I -H 'Range: bytes=0-9' "${url}a.l4d" | tr -d '\r' > head.text
expect_text head.text '^HTTP/1.1 200'

# Folders below, links within and the list; nothing else.
get /inner/b.l4d
expect_status 200 "a folder below"
get /good.l4d
expect_status 200 "a link within"
# links PATH: follows each link of a list. What they lead to is in `targets`, with what status in `statuses`.
links() {
  get "$1"
  expect_status 200 "the list of $1"
  "$PYTHON" - body "$url" > targets << 'END'
import html.parser, sys, urllib.parse
class Links(html.parser.HTMLParser):
    def handle_starttag(self, tag, attributes):
        assert tag in ("html", "meta", "title", "link", "ul", "li", "a"), tag
        if tag == "a":
            print(urllib.parse.urljoin(sys.argv[2], dict(attributes)["href"]))
Links().feed(open(sys.argv[1], encoding="utf-8").read())
END
  statuses=
  while read -r target; do
    statuses+="$(curl -s --max-time 120 -o linked -w '%{http_code}' "$target") "
  done < targets
}
links /
expect_equal "$(sed 's|.*/\(.\)|\1|' targets | paste -s -d ' ')" \
  "100%25%20%3Cb%3E%22%26amp%3B%23%3F%3B%2B%20%C3%A9%27.l4d a.l4d empty/ folder.l4d/ good.l4d inner/"
expect_equal "$statuses" "200 200 200 200 200 200 "
expect_text body '>100% &lt;b&gt;&quot;&amp;amp;#[?];[+] é'
links /inner/
expect_equal "$(wc -l < targets) $statuses" "2 200 200 "
links /empty/
expect_equal "$statuses" ""
# Files of several streams have playlists, as `manifest` writes them, and others have none.
l4d concat files/a.l4d files/inner/b.l4d -q -o 'files/empty/50% & c.l4d'
encoded=50%25%20%26%20c.l4d
expect 0 manifest 'files/empty/50% & c.l4d' -o files/empty/d.m3u8
get "/empty/$encoded.m3u8"
expect_status 200 "a playlist of a file"
expect_text head.text '^Content-Type: application/vnd.apple.mpegurl$'
cmp body files/empty/d.m3u8
get /empty/d.m3u8
expect_status 200 "a playlist that is a file"
expect_text head.text '^Content-Type: application/vnd.apple.mpegurl$'
cmp body files/empty/d.m3u8
for path in /a.l4d.m3u8 /missing.l4d.m3u8 /.m3u8 /folder.l4d.m3u8 /pipe.l4d.m3u8 /empty/d.m3u8.m3u8; do
  get "$path"
  expect_status 404 "$path"
done
links /empty/
expect_equal "$(sed 's|.*/||' targets | paste -s -d ' ') $statuses" "$encoded d.m3u8 200 200 "
# One that grows: without its index the playlist is open, and each request sees what is there.
l4d synth --scene cloud --seconds 4 --fps 10 -n 3000 --seed 3 -q -o grows.ply
l4d encode --live --segment 1 grows.ply -q -o grown.l4d
# ends: where each member ends.
"$PYTHON" - grown.l4d "$L4DCODEC" > ends << 'END'
import json, subprocess, sys
members = json.loads(subprocess.run([sys.argv[2], "manifest", sys.argv[1], "--json"], capture_output=True, check=True).stdout)["members"]
print(*(m["offset"] + m["bytes"] for m in members if m["role"] != "index"), sep="\n")
END
segments=0
while read -r end; do
  head -c "$end" grown.l4d > files/grows.l4d
  get /grows.l4d.m3u8
  expect_status 200 "a file that grows"
  ! grep -q ENDLIST body || die "a file without an index is complete"
  segments=$(grep -c '^grows.l4d$' body || true)
done < ends
expect_equal "$segments" 4
cp grown.l4d files/grows.l4d
get /grows.l4d.m3u8
expect_text body '^#EXT-X-ENDLIST$'
rm files/grows.l4d files/empty/*

get /inner
expect_status 301 "a folder without a slash"
expect_text head.text "^Location: .*/inner/\$"
for path in /link.l4d /.hidden /../outside.txt /%2e%2e/outside.txt /inner/../../outside.txt /..%2foutside.txt \
  /..%5coutside.txt //etc/passwd /pipe.l4d /dead.l4d /missing /missing/ /inner// /a.l4d/ /../ \
  /.play/missing.l4d /.play/pipe.l4d /.play/folder.l4d /.play/link.l4d /.play/ /a.l4d%00.txt /.play/../../outside.txt /.player/../a.l4d; do
  get "$path"
  expect_status 404 "$path"
done
with_token=$url
url=${url%/*/}/
for path in / /a.l4d /00000000000000000000000000000000/a.l4d; do
  get "$path"
  expect_status 404 "without the token, $path"
done
url=$with_token
get /a.l4d -H 'Host: evil.example'
expect_status 403 "another host"
get /a.l4d --request-target "${url%/}/a.l4d"
expect_status 200 "a whole URL in place of a path"
get /a.l4d --request-target "http://evil.example/${url#http://*/}a.l4d"
expect_status 403 "a whole URL of another host"
get /a.l4d -H "Host: localhost:$(echo "$url" | cut -d: -f3 | cut -d/ -f1)"
expect_status 200 "localhost"
for method in POST PUT DELETE; do
  get /a.l4d -X "$method" -d x
  [ "$status" -ge 400 ] || die "$method: status $status"
  ! cmp -s body files/a.l4d || die "$method answers"
done

# The server's own paths hide nothing.
mkdir files/play files/player
for name in play/a.l4d player/player.js play.l4d; do
  cp files/a.l4d "files/$name"
  get "/$name"
  expect_status 200 "$name"
  cmp body files/a.l4d
done
links /
expect_equal "$(grep -c '/play/$\|/player/$\|/play.l4d$' targets) $statuses" "3 200 200 200 200 200 200 200 200 200 "
rm -r files/play files/player files/play.l4d

# Many at a time, while some read slowly.
for k in 1 2 3 4; do
  curl -s --max-time 120 --limit-rate 4000 -r 0-7999 -o "slow.$k" "${url}a.l4d" &
  slow[k]=$!
done
for k in $(seq 24); do
  curl -s --max-time 120 -o "many.$k" "${url}a.l4d" &
  many[k]=$!
done
for k in $(seq 24); do
  wait "${many[$k]}" || die "one of many: status $?"
  cmp "many.$k" files/a.l4d
done
for k in 1 2 3 4; do
  wait "${slow[$k]}" || die "a slow one: status $?"
  head -c 8000 files/a.l4d | cmp - "slow.$k"
done

# A signal is how it ends, also while somebody has asked and does not read.
head -c 60000000 /dev/zero > files/large.l4d
"$PYTHON" - "$url" << 'END' &
import socket, sys, time
_, _, where, token = sys.argv[1].rstrip("/").split("/")
host, port = where.split(":")
with socket.create_connection((host, int(port))) as s:
    s.sendall(f"GET /{token}/large.l4d HTTP/1.1\r\nHost: {where}\r\n\r\n".encode())
    s.recv(1000)
    open("stalled", "w").close()
    time.sleep(60)
END
reader=$!
wait_for "a reader that stalls" test -e stalled
kill -INT "$server"
wait "$server" || die "exit status $?"
kill "$reader"
server=
rm files/large.l4d
expect_text address 'requests'

# A line when it listens, and a document when it has ended.
rm -f out
"$L4DCODEC" serve files --json > out 2> err &
server=$!
wait_for "the line of serve --json" test -s out
head -1 out > listening
expect_equal "$(wc -l < out)" 1
"$PYTHON" "$ROOT/tests/cli/check_schema.py" "$ROOT/docs/schema" listening || die "serve --json, when it listens"
expect_json listening "d['url'].startswith('http://%s:%d/' % (d['address'], d['port'])) and d['input'] == 'files'"
url=$(json listening "d['url']")
get /a.l4d
kill -TERM "$server"
wait "$server" || die "exit status $?"
server=
expect_empty err
tail -n +2 out > ended
"$PYTHON" "$ROOT/tests/cli/check_schema.py" "$ROOT/docs/schema" ended || die "serve --json"
expect_json ended "d['requests'] == 1 and d['bytes'] == $size and d['url'] == '$url'"
# Nobody would know where it is.
status=0
l4d serve files > /dev/full 2> err || status=$?
expect_equal "$status" 3

# Slow on demand: 0.2 s before, and 80 kbit take 0.4 s at 0.2 Mbit/s.
start_server serve files --delay 200 --rate 0.2
began=$(date +%s%N)
get /a.l4d -H 'Range: bytes=0-9999'
expect_status 206 "a slow range"
took=$((($(date +%s%N) - began) / 1000000))
[ "$took" -ge 580 ] || die "took $took ms"
port=$(echo "$url" | cut -d: -f3 | cut -d/ -f1)
expect 3 serve files --port "$port"
expect_text err 'port'
end_server

# view serves one file, with the player where the tool has it.
expect 3 serve missing
if has_player; then
  start_server view files/a.l4d --no-browser
  get /
  expect_status 200 "the page"
  expect_text body 'l4d-player'
  expect_text head.text '^Content-Security-Policy: default-src .none'
  for file in player.js worker.js sort-worker.js l4d.wasm; do
    get "/.player/$file"
    expect_status 200 "$file"
  done
  expect_text head.text '^Content-Type: application/wasm$'
  get /a.l4d
  expect_status 200 "the file"
  for path in /good.l4d /inner/b.l4d; do
    get "$path"
    expect_status 404 "another file, $path"
  done
  get /.play/a.l4d
  expect_status 200 "a page of the file"
  mv files/a.l4d files/moved
  for path in / /.play/a.l4d /a.l4d; do
    get "$path"
    expect_status 404 "a file that has gone, $path"
  done
  mv files/moved files/a.l4d
  end_server

  # A file of several streams plays by its playlist, and nothing else of the folder is served.
  expect 0 concat files/a.l4d files/a.l4d -o files/inner/several.l4d
  cp files/inner/several.l4d files/inner/other.l4d
  start_server view files/inner/several.l4d --no-browser
  expect_empty err
  get /
  expect_text body 'src="/[0-9a-f]*/several.l4d.m3u8"'
  get /several.l4d.m3u8
  expect_status 200 "its playlist"
  get /other.l4d.m3u8
  expect_status 404 "a playlist of another file"
  end_server
  start_server view files --no-browser
  get /.play/inner/several.l4d
  expect_text body 'src="/[0-9a-f]*/inner/several.l4d.m3u8"'
  get /.play/a.l4d
  expect_text body 'src="/[0-9a-f]*/a.l4d"'
  rm files/inner/several.l4d files/inner/other.l4d
  end_server

  # A folder: a list of links to pages.
  port=$("$PYTHON" -c 'import socket
s = socket.socket()
s.bind(("127.0.0.1", 0))
print(s.getsockname()[1])')
  start_server view files --port "$port" --no-browser
  case $url in
    "http://127.0.0.1:$port/"*) ;;
    *) die "--port $port: $url" ;;
  esac
  links /
  expect_equal "$statuses" "200 200 200 200 200 200 "
  expect_equal "$(grep -c '/[.]play/' targets)" 3
  get "/.play/$(sed -n '1s|.*/[.]play/||p' targets)"
  expect_status 200 "the page of an odd name"
  expect_text body "src=\"/[0-9a-f]*/100%25%20%3Cb%3E"
  for path in /.play/missing.l4d /.play/pipe.l4d /.play/folder.l4d /.play/link.l4d /.play/../outside.txt; do
    get "$path"
    expect_status 404 "$path"
  done
  end_server
  # A folder without streams has nothing to show.
  expect 4 view nothing --no-browser
  expect_text err '^l4dcodec: nothing: the folder has no streams [(][.]l4d[)]; .encode. makes one of frames$'
fi
expect 2 serve files --rate -1
expect 2 serve files --rate nan
expect 2 serve files --rate 5Mbit/h
expect_text err "^l4dcodec: --rate: '5Mbit/h'"
expect 2 serve files --rate 2Tbit/s
expect_text err '^l4dcodec: --rate is 2Tbit/s; it must be between 0 and 1000000 Mbit/s$'

# A stream may come later: where there is none yet, a note and the page say so.
start_server serve nothing --rate 125kB/s
expect_text err '^note: nothing: the folder has no streams [(][.]l4d[)] yet'
get /
expect_text body 'There is no stream in this folder yet'
cp files/a.l4d nothing/inner/
get /inner/
expect_text body 'a[.]l4d</a>'
! grep -q 'no stream' body || die "a stream is there"
end_server
start_server serve nothing --rate 1Mbit/s
expect_empty err
end_server

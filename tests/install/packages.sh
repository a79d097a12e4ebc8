#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: packages.sh BUILD [OPTION...]
# Makes what a release has in BUILD, with OPTION for CMake, and uses it as a stranger would: the source archive without git,
# and the Debian packages in a root that has what they depend on and a compiler, where each command and program of
# README runs. Then it removes them, which leaves nothing. Exit status 77 if that cannot be tried here.
set -euo pipefail
build=$(realpath -m "$1")
out=$build/release
here=$(cd "$(dirname "$0")" && pwd)
source=$(cd "$here/../.." && pwd)
fail() {
  echo "FAIL: $*" >&2
  exit 1
}
skip() {
  echo "SKIPPED: $*"
  exit 77
}
command -v dh >/dev/null || skip "no debhelper (./dev setup packages)"
[[ $(id -u) == 0 ]] || skip "a root of its own wants root"
"$source/packaging/package.sh" "$build" "${@:2}"
version=$(sed -n 's/^CMAKE_PROJECT_VERSION:STATIC=//p' "$build/CMakeCache.txt")

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

echo "== lintian"
if command -v lintian >/dev/null; then
  # No bug of Debian asks for the package, and no release of Debian has it.
  lintian --fail-on error,warning --suppress-tags initial-upload-closes-no-bugs,bad-distribution-in-changes-file \
    "$out"/*.changes
else
  echo "not tried: no lintian"
fi

echo "== source archive"
tar -C "$work" -xf "$out/l4dcodec-$version.tar.gz"
tree=$work/l4dcodec-$version
(
  cd "$tree"
  # No git above the tree may help.
  export GIT_DIR=/nonexistent
  cmake --preset release -DL4D_CUDA=OFF >"$work/log" 2>&1 || fail "configuring the archive: $(tail "$work/log")"
  # All that any target is made of is there.
  ninja -C build/release -n >"$work/log" 2>&1 || fail "the archive lacks a file: $(tail "$work/log")"
  # The part that all others need, unoptimised: compilers find what the lists of files do not name.
  cmake --preset decoder -DCMAKE_BUILD_TYPE=Debug >"$work/log" 2>&1 || fail "configuring the decoder: $(tail "$work/log")"
  cmake --build build/decoder -j "${L4D_JOBS:-$(nproc)}" --target l4d_core >"$work/log" ||
    fail "building the decoder: $(tail "$work/log")"
)
# An archive of the unpacked archive is the same.
rm -rf "$tree/build"
cmp <(tar -tf "$out/l4dcodec-$version.tar.gz") <(cd "$work" && find "l4dcodec-$version" -type f | LC_ALL=C sort) ||
  fail "the archive and what is unpacked have different files"

echo "== an install of the tool alone, as after ./dev demo"
mv "$build/bin/l4dtrain" "$build/pages" "$work/"
cmake --install "$build" --prefix "$work/partly" >"$work/log" || fail "installing a part: $(tail "$work/log")"
mv "$work/l4dtrain" "$build/bin/"
mv "$work/pages" "$build/"
for name in bin/l4dtrain l4dcodec.1; do
  grep -q "Left out: .*$name" "$work/log" || fail "nothing says that $name is left out"
done
[[ -x $work/partly/bin/l4dcodec ]] || fail "the tool is not installed"

echo "== a clean root"
root=$work/root
mkdir "$root"
ours=$(for file in "$out"/*.deb; do dpkg-deb -f "$file" Package; done)
needed=$(for file in "$out"/*.deb; do
  dpkg-deb -f "$file" Depends | tr ',' '\n' | sed 's/^ *//; s/[ (:|].*//'
done | sed '/^$/d' | sort -u | grep -vxF "$ours")
mapfile -t needed <<<"$needed"
python3 -B "$here/clean_root.py" "$root" "${needed[@]}" python3 gcc g++ cmake make pkg-config
cp -a /dev/null "$root/dev/"
chmod 1777 "$root/tmp"
# What there is, but for logs and dpkg's own notes.
list() { (cd "$root" && find . -path ./var/lib/dpkg -prune -o -path ./var/log -prune -o -path ./tmp -prune -o -print | LC_ALL=C sort); }
in_root() { env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/tmp LC_ALL=C.UTF-8 DEBIAN_FRONTEND=noninteractive chroot "$root" "$@"; }
in_root ldconfig
list >"$work/before"
cp "$out"/*.deb "$root/tmp/"
in_root sh -c 'dpkg -i /tmp/*.deb' >"$work/log" 2>&1 || fail "dpkg -i: $(cat "$work/log")"
rm "$root"/tmp/*.deb
list >"$work/installed"
echo "$(comm -13 "$work/before" "$work/installed" | wc -l) files and folders are installed"
cp "$source/README.md" "$source/tests/docs/run.py" "$root/tmp/"
in_root sh -c 'cd /tmp && python3 -B run.py --installed /usr README.md'
in_root l4dtrain --help | grep -q capture || fail "l4dtrain does not run"
[[ -e $root/usr/share/man/man1/l4dcodec.1.gz ]] || fail "no man page"
if readelf -d "$root/usr/bin/l4dcodec" "$root"/usr/lib/*/libl4d*.so.* | grep -E 'R(UN)?PATH'; then
  fail "an installed file has a search path"
fi
rm -rf "${root:?}"/tmp/*
# shellcheck disable=SC2086 # names of packages
in_root dpkg --purge $ours >"$work/log" 2>&1 || fail "dpkg --purge: $(cat "$work/log")"
list | diff "$work/before" - >&2 || fail "the packages leave something (>) or take something away (<)"

python3 - "$out/l4dcodec-$version.spdx.json" <<'PYTHON'
import json
import sys
document = json.load(open(sys.argv[1]))
assert document["spdxVersion"] == "SPDX-2.3" and len(document["packages"]) > 8, document
assert all(package["versionInfo"] != "NOASSERTION" for package in document["packages"] if package["name"] != "ffmpeg")
PYTHON
(cd "$out" && sha256sum --quiet -c SHA256SUMS && du -b ./*.deb ./*.gz ./*.json ./*.tgz 2>/dev/null | sort -k 2) || true
echo "packages: installed, used and removed"

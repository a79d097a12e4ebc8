#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: package.sh BUILD [OPTION...]
# Makes in BUILD/release what a release has: the source archive, Debian packages of this machine's architecture, npm
# archives of build/web where ./dev web made it, and the list of licences (SPDX). Builds in BUILD, with OPTION
# for CMake. The same sources give the same bytes: times are that of the last commit, or SOURCE_DATE_EPOCH.
set -euo pipefail
build=$(realpath -m "$1")
out=$build/release
options=("${@:2}")
cd "$(dirname "${BASH_SOURCE[0]}")/.."
jobs=${L4D_JOBS:-$(nproc)}
number=$(sed -n 's/^project(l4dcodec VERSION \([0-9.]*\) .*/\1/p' CMakeLists.txt)
name=l4dcodec-$number

# The files of the project: those that git knows, or, in an unpacked archive, all.
source_files() {
  if [[ -e .git ]]; then
    git ls-files -z
  else
    find . -path ./build -prune -o -path ./web/node_modules -prune -o -type f -printf '%P\0'
  fi | LC_ALL=C sort -z
}
if [[ -z ${SOURCE_DATE_EPOCH:-} ]]; then
  SOURCE_DATE_EPOCH=$(git log -1 --format=%ct 2>/dev/null || stat -c %Y CMakeLists.txt)
fi
export SOURCE_DATE_EPOCH

rm -rf "$out" "$build/debian"
mkdir -p "$out"

echo "== source archive"
source_files | tar --null --files-from=- --transform "s,^,$name/," --sort=name --mtime="@$SOURCE_DATE_EPOCH" \
  --owner=0 --group=0 --numeric-owner --mode=go+u,go-w -cf - | gzip -9n >"$out/$name.tar.gz"

echo "== licences"
python3 -B packaging/sbom.py >"$out/$name.spdx.json"

echo "== build"
# Shared and static libraries and the tools, of the same objects. Device code stays out: it wants a toolkit.
libraries=lib
! command -v dpkg-architecture >/dev/null || libraries=lib/$(dpkg-architecture -qDEB_HOST_MULTIARCH)
# The system's folders need no search path, so none is in the files. In the build the man page's program runs.
export LD_LIBRARY_PATH=$build/$libraries
cmake -S . -B "$build" -G Ninja -DCMAKE_BUILD_TYPE=Release -DCMAKE_INSTALL_PREFIX=/usr \
  -DCMAKE_INSTALL_LIBDIR="$libraries" -DCMAKE_SKIP_RPATH=ON -DBUILD_SHARED_LIBS=ON -DL4D_STATIC_TOO=ON \
  -DL4D_BUILD_TESTS=OFF -DL4D_BUILD_BENCH=OFF -DL4D_CUDA=OFF -DL4D_MPI=OFF -DL4D_PYTHON=OFF -DL4D_SIGNATURES=ON \
  -DL4D_WEBP=ON \
  -DL4D_BUILD_VIEW=ON "${options[@]}" >"$build/configure.log" || {
  cat "$build/configure.log" >&2
  exit 1
}
cmake --build "$build" -j "$jobs"

echo "== Debian packages"
work=$build/debian/tree
abi=${number%.*}
mkdir -p "$work"
cp -r packaging/debian README.md docs examples CHANGELOG.md "$work/"
cp spec/l4d.md "$work/docs/"
rm -rf "$work/docs/accuracy/results.json"
maintainer="${DEBFULLNAME:-l4dcodec maintainers} <${DEBEMAIL:-maintainers@example.org}>"
sed -i -e "s/@MAINTAINER@/$maintainer/" -e "s/@ABI@/$abi/" "$work/debian/control"
for file in "$work"/debian/libl4dcodec.*; do mv "$file" "${file/libl4dcodec./libl4dcodec$abi.}"; done
printf 'l4dcodec (%s) unstable; urgency=medium\n\n  * CHANGELOG.md has the changes.\n\n -- %s  %s\n' \
  "$number" "$maintainer" "$(date -uRd "@$SOURCE_DATE_EPOCH")" >"$work/debian/changelog"
(cd "$work" && L4D_PACKAGE_BUILD=$build dpkg-buildpackage -b -us -uc -d) >"$build/debian.log" 2>&1 || {
  tail -n 40 "$build/debian.log" >&2
  exit 1
}
mv "$build"/debian/*.deb "$build"/debian/*.changes "$build"/debian/*.buildinfo "$out/"
rm -rf "$build/debian"

echo "== npm archives"
for package in l4dcodec l4dcodec-player l4dcodec-spark l4dcodec-three l4dcodec-babylon l4dcodec-playcanvas; do
  if [[ -d build/web/$package ]]; then
    (cd "$out" && npm pack --silent "$OLDPWD/build/web/$package")
  else
    echo "left out: build/web/$package is not there (./dev web)"
  fi
done
(cd "$out" && find . -maxdepth 1 -type f -printf '%f\0' | LC_ALL=C sort -z | xargs -0 sha256sum) >"$out.sums"
mv "$out.sums" "$out/SHA256SUMS"

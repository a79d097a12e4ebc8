#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: run.sh static|shared|both|decoder BUILD_DIR [SOURCE_DIR [OPTION...]]
# Installs BUILD_DIR into a temporary prefix, moves the tree and uses it where it then lies: the file
# list, the symbols, the pkg-config files and the CMake package, from C and from C++. With SOURCE_DIR,
# BUILD_DIR is first made, with OPTION for CMake: the libraries alone, of that kind; `both` has shared and static libraries of
# one build, and `decoder` is a static build without the encoder and what it needs. L4D_UPDATE_GOLDEN=1 rewrites the lists instead of comparing.
set -euo pipefail

kind=$1
build=$2
here=$(cd "$(dirname "$0")" && pwd)
jobs=${L4D_JOBS:-$(nproc)}

fail() {
  echo "FAIL: $*" >&2
  exit 1
}

cache_value() { sed -n "s/^$1:[A-Z]*=//p" "$build/CMakeCache.txt"; }

# compare NAME: standard input against the stored list NAME.
compare() {
  if [[ ${L4D_UPDATE_GOLDEN:-0} == 1 ]]; then
    cat >"$here/$1"
  else
    diff -u "$here/$1" - >&2 || fail "$1 differs (< stored, > this build)"
  fi
}

if [[ $# -ge 3 ]]; then
  options=()
  [[ $kind != shared ]] || options=(-DBUILD_SHARED_LIBS=ON)
  [[ $kind != both ]] || options=(-DBUILD_SHARED_LIBS=ON -DL4D_STATIC_TOO=ON)
  # Eigen hidden: a decoder must not want it.
  [[ $kind != decoder ]] || options=(-DL4D_BUILD_ENCODER=OFF -DL4D_BUILD_RENDER=OFF
    -DCMAKE_DISABLE_FIND_PACKAGE_Eigen3=ON)
  cmake -S "$3" -B "$build" -G Ninja -DCMAKE_BUILD_TYPE=Release "${options[@]}" \
    -DL4D_BUILD_CLI=OFF -DL4D_BUILD_TESTS=OFF -DL4D_BUILD_BENCH=OFF -DL4D_CUDA=OFF "${@:4}"
  cmake --build "$build" -j "$jobs"
fi

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cmake --install "$build" --prefix "$work/installed" >"$work/install.log"
prefix=$work/moved
mv "$work/installed" "$prefix"
libdir=$(cache_value CMAKE_INSTALL_LIBDIR)
library=$prefix/$libdir
version=$(sed -n 's/^CMAKE_PROJECT_VERSION:STATIC=//p' "$build/CMakeCache.txt")
[[ -n $version ]] || fail "no version in $build/CMakeCache.txt"
cc=$(cache_value CMAKE_C_COMPILER)
cxx=$(cache_value CMAKE_CXX_COMPILER)
packages=(l4dcodec)
programs=(consumer_decode)
if [[ $kind != decoder ]]; then
  packages+=(l4dencoder l4drender)
  programs+=(encode_arrays draw_instant) # of the examples: one makes the stream that the other draws
fi
source_of() { [[ $1 == consumer_decode ]] && echo "$here/$1.c" || echo "$here/../../examples/$1.c"; }
# check PROGRAM: runs one that was built.
check() {
  case ${1##*/} in
    encode_arrays) "$1" "$work/scene.l4d" | tail -n 1 ;;
    draw_instant)
      "$1" "$work/scene.l4d" 1 "$work/picture.ppm"
      (($(wc -c <"$work/picture.ppm") == 15 + 3 * 640 * 360)) || fail "the picture of $1"
      ;;
    *) "$1" ;;
  esac
}

echo "== files"
(cd "$prefix" && find . -type f -o -type l) |
  sed -e 's|^\./||' -e "s|^$libdir/|LIBDIR/|" -e 's|-release\.cmake$|-CONFIG.cmake|' \
    -e 's|-debug\.cmake$|-CONFIG.cmake|' -e "s|$version|VERSION|" | LC_ALL=C sort >"$work/files"
# What depends on options: the tool with its pages, and the CUDA runtime.
tool='^(bin|share/(man|bash-completion|zsh|fish))/'
grep -vE -e "$tool" -e '^LIBDIR/libl4dcudart\.a$' "$work/files" | compare "files-$kind.txt"
if [[ $(cache_value L4D_BUILD_CLI) == ON ]]; then
  # A build without the trainer has all of the list but that.
  trainer=$(cache_value L4D_TRAINING)
  {
    [[ $trainer == ON ]] || echo bin/l4dtrain
    grep -E "$tool" "$work/files"
  } | LC_ALL=C sort | compare files-tool.txt
  [[ $trainer != ON ]] || "$prefix/bin/l4dtrain" --help | grep -q capture
  LD_LIBRARY_PATH=$library "$prefix/bin/l4dcodec" version
fi
# Nothing names a place that only the machine which built it has.
for place in "$work/installed" "$(cache_value CMAKE_INSTALL_PREFIX)" "$build" /usr/local/cuda; do
  if grep -rIF -- "$place/" "$prefix" >&2; then fail "an installed file names $place"; fi
done

# The same list for both kinds: what the archive offers as the C API is what the shared object exports,
# and a shared object exports nothing else.
echo "== symbols"
# symbols FILE
symbols() {
  if [[ $1 == *.so ]]; then
    nm -D --defined-only "$1" | awk '$2 != "A" { sub(/@.*/, "", $3); print $3 }'
  else
    nm -g --defined-only "$1" 2>"$work/nm.log" | awk '$2 == "T" && $3 ~ /^l4d_/ { print $3 }'
  fi | LC_ALL=C sort
}
case $kind in
  shared) suffixes=(so) ;;
  both) suffixes=(so a) ;;
  *) suffixes=(a) ;;
esac
# declared HEADER...
declared() {
  # A decoder alone defines what these declare, and comes without the headers.
  if [[ $kind == decoder ]]; then
    cp "$here/../../include/l4d/cuda.h" "$prefix/include/l4d/"
    cp "$here/../../include/l4d/experimental/cuda_packed.h" "$prefix/include/l4d/experimental/"
  fi
  grep -hoE 'L4D_API [^(]*\(' "${@/#/$prefix/include/l4d/}" | grep -oE 'l4d_[a-z0-9_]+\($' | tr -d '(' |
    LC_ALL=C sort
}
for package in "${packages[@]}"; do
  list=symbols-${package#l4d}.txt
  for suffix in "${suffixes[@]}"; do symbols "$library/lib$package.$suffix" | compare "$list"; done
  case $package in
    l4dcodec) headers=({l4d,decode,members,playback,cuda}.h experimental/{inspect,packed,columns,copy,cuda_packed}.h) ;;
    l4dencoder) headers=(encode.h experimental/session.h) ;;
    l4drender) headers=(render.h experimental/{sensitivity,cuda_render,cuda_player,cuda_train}.h) ;;
  esac
  declared "${headers[@]}" | diff -u - "$here/$list" >&2 ||
    fail "declared (<) and defined (>) functions of $package differ"
done

# build_and_run PROGRAM FLAG...: a C program with the flags of pkg-config.
build_and_run() {
  local program=$1
  shift
  "$cc" -std=c99 -pedantic -Wall -Wextra -Werror "$(source_of "$program")" -o "$work/$program" "$@" -lm
  LD_LIBRARY_PATH=$library check "$work/$program"
}

links_no_shared() {
  if readelf -d "$1" | grep 'NEEDED.*libl4d' >&2; then fail "$1 links a shared library"; fi
}

echo "== pkg-config, as it is and with --static"
export PKG_CONFIG_PATH=$library/pkgconfig
[[ $(pkg-config --modversion l4dcodec) == "$version" ]] || fail "version in l4dcodec.pc"
for i in "${!programs[@]}"; do
  # Only static archives link with --static, and they link without it too.
  for mode in '' --static; do
    [[ -z $mode || $kind != shared ]] || continue
    # The .pc files have to know by themselves where they lie.
    read -ra flags <<<"$(pkg-config --dont-define-prefix $mode --cflags --libs "${packages[$i]}")"
    # Of both kinds the linker takes the shared library, unless the other is named.
    if [[ $kind == both && -n $mode ]]; then
      for k in "${!flags[@]}"; do
        if [[ ${flags[k]} == -ll4d* ]]; then flags[k]=-l:lib${flags[k]#-l}.a; fi
      done
    fi
    build_and_run "${programs[$i]}" "${flags[@]}"
    if [[ $kind == both ]]; then
      [[ -n $mode ]] && expected=0 || expected=1
      (($(readelf -d "$work/${programs[$i]}" | grep -c 'NEEDED.*libl4d') >= expected)) ||
        fail "${programs[$i]} does not link the shared library"
      [[ -z $mode ]] || links_no_shared "$work/${programs[$i]}"
    fi
  done
done

# find_package FOLDER OPTION...: configures and builds the project of a stranger without CUDA.
find_package() {
  local folder=$1
  shift
  cmake -S "$here/$folder" -B "$work/build-$folder" -G Ninja -DCMAKE_BUILD_TYPE=Release \
    -DCMAKE_PREFIX_PATH="$prefix" -DCMAKE_C_COMPILER="$cc" \
    -DCMAKE_DISABLE_FIND_PACKAGE_CUDAToolkit=ON "$@" >"$work/configure.log" 2>&1 || {
    cat "$work/configure.log" >&2
    fail "find_package in $folder"
  }
  cmake --build "$work/build-$folder"
}
echo "== find_package from C alone"
find_package consumer-c -DPROGRAMS="$(IFS=';' && echo "${programs[*]}")"
for program in "${programs[@]}"; do check "$work/build-consumer-c/$program"; done
if [[ $kind == both ]]; then
  echo "== find_package, the static libraries"
  rm -rf "$work/build-consumer-c"
  find_package consumer-c -DSUFFIX=_static -DPROGRAMS="$(IFS=';' && echo "${programs[*]}")"
  for program in "${programs[@]}"; do
    check "$work/build-consumer-c/$program"
    links_no_shared "$work/build-consumer-c/$program"
  done
fi
if [[ $kind != decoder ]]; then
  echo "== find_package from C++"
  find_package consumer -DCMAKE_CXX_COMPILER="$cxx" -DEXPECTED_VERSION="$version"
  check "$work/build-consumer/encode_arrays"
fi
echo "install test of the $kind library: ok"

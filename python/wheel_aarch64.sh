#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: wheel_aarch64.sh FOLDER [STREAM.l4d PYTHONPATH]
# Builds the package for Linux on aarch64 with Debian's cross compiler, and a wheel of it in FOLDER/wheels. With a
# stream, Python of that machine then opens it under qemu-user, and decodes what the package in PYTHONPATH decodes here.
# What is linked and run comes out of Debian's packages for arm64, which are unpacked into FOLDER/root and not installed.
# Exit status 77: no cross compiler or emulator.
set -euo pipefail
to=$(mkdir -p "${1:?"usage: wheel_aarch64.sh FOLDER [STREAM.l4d PYTHONPATH]"}" && realpath "$1")
source=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
root=$to/root triplet=aarch64-linux-gnu
for program in $triplet-g++ qemu-aarch64 apt-get flatc; do
  if ! command -v "$program" >/dev/null; then
    echo "SKIPPED: no $program (./dev setup build cross python)"
    exit 77
  fi
done

if [[ ! -e $root/complete ]]; then
  echo "== packages for arm64"
  mkdir -p "$to"/{lists/partial,cache/archives/partial,debs} "$root"
  : >"$to/status"
  apt=(-qq -o APT::Architecture=arm64 -o APT::Architectures=arm64 -o "Dir::State::Lists=$to/lists"
    -o "Dir::State::Status=$to/status" -o "Dir::Cache=$to/cache" -o APT::Sandbox::User=root)
  apt-get "${apt[@]}" update
  mapfile -t packages < <(apt-get "${apt[@]}" -q=1 install -s --no-install-recommends python3-numpy python3-cffi \
    libpython3-dev libzstd-dev libxxhash-dev libhwy-dev libpng-dev zlib1g-dev libwebp-dev | sed -n 's/^Inst \([^ ]*\) .*/\1/p')
  (cd "$to/debs" && apt-get "${apt[@]}" download "${packages[@]}")
  for package in "$to"/debs/*.deb; do
    dpkg-deb -x "$package" "$root"
  done
  touch "$root/complete"
fi

echo "== package"
python=$(cd "$root/usr/include" && echo python3.[0-9]*)
# Python's headers include a file of the machine by a path below this.
mkdir -p "$to/include/$triplet"
ln -sfn "$root/usr/include/$triplet/$python" "$to/include/$triplet/$python"
launchers=()
if command -v ccache >/dev/null; then
  launchers=(-DCMAKE_C_COMPILER_LAUNCHER=ccache -DCMAKE_CXX_COMPILER_LAUNCHER=ccache)
fi
export PKG_CONFIG_LIBDIR=$root/usr/lib/$triplet/pkgconfig PKG_CONFIG_SYSROOT_DIR=$root
cmake -S "$source" -B "$to/build" -G Ninja --log-level=WARNING -DCMAKE_BUILD_TYPE=Release \
  -DCMAKE_TOOLCHAIN_FILE="$source/tests/cross/aarch64.cmake" -DCMAKE_FIND_ROOT_PATH="$root" \
  -DCMAKE_LIBRARY_ARCHITECTURE=$triplet -DPKG_CONFIG_EXECUTABLE="$(command -v pkg-config)" \
  -DFLATC="$(command -v flatc)" -DEigen3_DIR=/usr/share/eigen3/cmake -Dnlohmann_json_DIR=/usr/share/cmake/nlohmann_json \
  -DL4D_PYTHON=ON -DL4D_PYTHON_INTERPRETER=/usr/bin/python3 \
  "-DL4D_PYTHON_HEADERS=$root/usr/include/$python;$to/include" -DL4D_CUDA=OFF -DL4D_WEBP=AUTO -DL4D_BUILD_CLI=OFF \
  -DL4D_TRAINING=OFF -DL4D_BUILD_TESTS=OFF -DL4D_BUILD_BENCH=OFF "${launchers[@]}"
cmake --build "$to/build" -j "${L4D_JOBS:-$(nproc)}" --target python

echo "== wheel"
rm -rf "$to/wheels" "$to/installed"
L4D_PYTHON_BUILT=$to/build/python/l4dcodec L4D_PYTHON_LIBRARIES=$root/usr/lib/$triplet \
  _PYTHON_HOST_PLATFORM=linux-aarch64 /usr/bin/python3 -m pip wheel --quiet --no-build-isolation --no-deps \
  --wheel-dir "$to/wheels" "$source/python"
rm -rf "$source"/python/{build,l4dcodec.egg-info} # pip builds in the folder itself
ls -l "$to"/wheels
[[ $# -gt 1 ]] || exit 0

echo "== decoding under qemu"
/usr/bin/python3 -m zipfile -e "$to"/wheels/l4dcodec-*-linux_aarch64.whl "$to/installed"
cat >"$to/digest.py" <<'PYTHON'
import hashlib, io, platform, sys, l4dcodec
with l4dcodec.open(sys.argv[1]) as stream:
    scene, stream_bytes = stream.decode(), io.BytesIO()
    assert len(stream.slice(0.5)) > 0
    l4dcodec.encode(scene, stream_bytes, preset="lossless")
    again = l4dcodec.open(stream_bytes.getvalue()).decode()
names = "position", "mean_t", "log_scale", "rotor", "opacity", "sh"
print(hashlib.sha256(b"".join(getattr(scene, name).tobytes() for name in names)).hexdigest())
assert len(again) == len(scene) and sorted(again.opacity) == sorted(scene.opacity)
print(platform.machine(), l4dcodec.__version__, len(scene), "Gaussians", file=sys.stderr)
PYTHON
here=$(PYTHONPATH=$3 /usr/bin/python3 -B "$to/digest.py" "$2")
libraries=$root/usr/lib/$triplet
there=$(PYTHONPATH=$to/installed:$root/usr/lib/python3/dist-packages qemu-aarch64 -L "$root" \
  -E LD_LIBRARY_PATH="$libraries:$libraries/blas:$libraries/lapack" -E PYTHONHOME="$root/usr" \
  "$root/usr/bin/$python" -B "$to/digest.py" "$2")
[[ $here == "$there" ]] || {
  echo "FAIL: the Gaussians of $2 are others on aarch64" >&2
  exit 1
}
echo "the same Gaussians, bit for bit"

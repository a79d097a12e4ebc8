# SPDX-License-Identifier: Apache-2.0
"""Makes wheels of the package: CMake builds the extension, or L4D_PYTHON_BUILT names a folder that has it."""

import os
import pathlib
import re
import shutil
import subprocess
import sys
from typing import Dict

from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext
from wheel.bdist_wheel import bdist_wheel

ROOT = pathlib.Path(__file__).resolve().parents[1]
MODULE = "_native.abi3.so"
# Of what the extension links, Debian's packages have no static form that fits into it.
BROUGHT = ("libhwy.so.1", "libxxhash.so.0", "libzstd.so.1", "libpng16.so.16", "libwebp.so.7")


class BuildWithCMake(build_ext):
    def get_ext_filename(self, fullname: str) -> str:
        return os.path.join(*fullname.split(".")[:-1], MODULE)

    def build_extension(self, extension: Extension) -> None:
        built = os.environ.get("L4D_PYTHON_BUILT")
        if built is None:
            build = os.path.abspath(self.build_temp)
            subprocess.run(["cmake", "-S", ROOT, "-B", build, "-DCMAKE_BUILD_TYPE=Release", "-DL4D_PYTHON=ON",
                            "-DL4D_BUILD_CLI=OFF", "-DL4D_TRAINING=OFF", "-DL4D_BUILD_TESTS=OFF",
                            "-DL4D_BUILD_BENCH=OFF", "-DL4D_WEBP=AUTO", f"-DL4D_PYTHON_INTERPRETER={sys.executable}"], check=True)
            subprocess.run(["cmake", "--build", build, "--parallel", "--target", "python"], check=True)
            built = os.path.join(build, "python", "l4dcodec")
        to = pathlib.Path(self.get_ext_fullpath(extension.name)).parent
        to.mkdir(parents=True, exist_ok=True)
        shutil.copy(os.path.join(built, MODULE), to)
        if os.path.exists(os.path.join(built, "player.js")):
            shutil.copy(os.path.join(built, "player.js"), to)
        for name, path in self.libraries_of(to / MODULE).items():
            if name in BROUGHT:
                shutil.copy(path, to / name)

    @staticmethod
    def libraries_of(module: pathlib.Path) -> Dict[str, str]:
        """Name -> path of the shared libraries that the module needs. L4D_PYTHON_LIBRARIES names the folder of those of
        another machine, where the system's own say nothing."""
        folder = os.environ.get("L4D_PYTHON_LIBRARIES")
        if folder is not None:
            return {path.name: str(path) for path in pathlib.Path(folder).iterdir()}
        out = subprocess.run(["ldd", module], check=True, capture_output=True, text=True).stdout
        return dict(re.findall(r"(\S+) => (/\S+)", out))


class StableAbi(bdist_wheel):
    def finalize_options(self) -> None:
        self.py_limited_api = "cp39"
        super().finalize_options()


version = re.search(r"project\(l4dcodec VERSION ([0-9.]+)", (ROOT / "CMakeLists.txt").read_text(encoding="utf-8"))
assert version is not None
setup(version=version.group(1), cmdclass={"build_ext": BuildWithCMake, "bdist_wheel": StableAbi},
      ext_modules=[Extension("l4dcodec._native", [], py_limited_api=True)])

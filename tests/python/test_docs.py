# SPDX-License-Identifier: Apache-2.0
"""The Python of docs/python.md and of README.md runs, from its first line to its last."""

import os
import pathlib
import re
import shutil
import subprocess

import pytest

import l4dcodec

SOURCE = pathlib.Path(os.environ["L4D_SOURCE"])


@pytest.mark.parametrize("page,least", [("docs/python.md", 6), ("README.md", 1)])
def test_snippets(folder: pathlib.Path, tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch, page: str,
                  least: int) -> None:
    for name in ("scene.ply", "scene.l4d"):
        shutil.copy(folder / name, tmp_path)
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"^```python\n(.*?)^```", (SOURCE / page).read_text(encoding="utf-8"), re.M | re.S)
    assert len(blocks) >= least
    assert l4dcodec.__doc__
    blocks.append(re.sub("^    ", "", "".join(re.findall("^    .*\n", l4dcodec.__doc__, re.M)), flags=re.M))
    names: "dict[str, object]" = {}
    for block in blocks:
        exec(compile(block, page, "exec"), names)


def test_what_the_page_says_of_slices() -> None:
    page = (SOURCE / "docs/python.md").read_text(encoding="utf-8")
    for name in re.findall(r"^\| `(\w+)` \|", page, re.M):
        assert name in l4dcodec.Splats.__dataclass_fields__ or hasattr(l4dcodec.Splats, name)


def test_all_that_is_public_is_described() -> None:
    for name in l4dcodec.__all__:
        value = getattr(l4dcodec, name)
        assert value.__doc__ and not value.__doc__.startswith(f"{name}("), name
        for member, item in vars(value).items() if isinstance(value, type) else ():
            if callable(item) and not member.startswith("_") and name not in ("Status", "Record"):
                assert item.__doc__ or member in ("of_c", "to_c"), f"{name}.{member}"


@pytest.mark.skipif(shutil.which("cmake") is None, reason="there is no CMake")
def test_a_build_of_the_package_alone_has_all_that_it_links(tmp_path: pathlib.Path) -> None:
    """As `pip install ./python` configures it."""
    options = re.findall(r'"(-D[A-Z0-9_]+=[A-Za-z]+)"', (SOURCE / "python/setup.py").read_text(encoding="utf-8"))
    assert "-DL4D_PYTHON=ON" in options and "-DL4D_BUILD_CLI=OFF" in options
    subprocess.run(["cmake", "-S", SOURCE, "-B", tmp_path, "-G", "Ninja", "-DL4D_CUDA=OFF", *options], check=True,
                   stdout=subprocess.DEVNULL)
    linked = (tmp_path / "build.ninja").read_text(encoding="utf-8")
    linked = linked[linked.index("build python/l4dcodec/_native.abi3.so"):].split("\n\n", 1)[0]
    for library in ("eval/libl4d_eval.a", "io/libl4d_io.a", "libl4dencoder.a", "libl4drender.a"):
        assert library in linked, library

# SPDX-License-Identifier: Apache-2.0
"""Files that the tests share. The tool makes them: what Python makes is held against it."""

import os
import pathlib
import subprocess

import pytest

TOOL = os.environ["L4D_TOOL"]


def tool(*arguments: object) -> str:
    return subprocess.run([TOOL, *map(str, arguments)], check=True, capture_output=True, text=True).stdout


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    """scene.ply, 2 s of 3,000 Gaussians; scene.l4d and lossless.l4d, encoded."""
    path: pathlib.Path = tmp_path_factory.mktemp("scenes")
    tool("synth", "--scene", "cloud", "--seconds", 2, "--gaussians", 3000, "-o", path / "scene.ply")
    tool("encode", path / "scene.ply", "--estimate", "-o", path / "scene.l4d")
    tool("encode", path / "scene.ply", "--preset", "lossless", "-o", path / "lossless.l4d")
    return path

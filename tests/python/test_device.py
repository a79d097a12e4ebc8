# SPDX-License-Identifier: Apache-2.0
"""Tensors on a CUDA device: those of the host, bit by bit."""

import dataclasses
import pathlib
import sys
from typing import Any, Dict, List

import numpy as np
import pytest

import l4dcodec as l4d


def test_without_torch_it_says_so(folder: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> None:
    modules: Dict[str, Any] = sys.modules
    monkeypatch.setitem(modules, "torch", None)
    with l4d.open(folder / "scene.l4d") as stream:
        with pytest.raises(l4d.Error, match="PyTorch, which is not here") as error:
            stream.decode_cuda()
    assert error.value.status == l4d.Status.FEATURE_UNSUPPORTED


def test_a_device_that_is_not_there_is_an_error(folder: pathlib.Path) -> None:
    pytest.importorskip("torch")
    with l4d.open(folder / "scene.l4d") as stream:
        with pytest.raises(l4d.Error) as error:
            stream.decode_cuda(device=1000)
        assert error.value.status in (l4d.Status.DEVICE, l4d.Status.FEATURE_UNSUPPORTED, l4d.Status.INVALID_ARGUMENT)


@pytest.mark.parametrize("name", ["scene", "lossless", "windows"])
def test_tensors_have_the_bits_of_the_host(folder: pathlib.Path, tmp_path: pathlib.Path, name: str) -> None:
    torch = pytest.importorskip("torch")
    if not torch.cuda.is_available():
        pytest.skip("no CUDA device")
    path = folder / f"{name}.l4d"
    if name == "windows":
        path, begin = tmp_path / "windows.l4d", np.arange(3000, dtype=np.uint32) % 60
        scene = l4d.read(folder / "scene.ply")
        l4d.encode(dataclasses.replace(scene, window=np.stack([begin, begin + 1], 1)), path)
    with l4d.open(path) as stream:
        cases: List[Dict[str, Any]] = [{}, {"time": 0.7}, {"range": (0.5, 1), "detail": "base"}]
        for arguments in cases:
            scene, tensors = stream.decode(**arguments), stream.decode_cuda(**arguments)
            assert len(scene) == len(tensors["opacity"]) > 0
            for key in ("position", "log_scale", "rotor", "opacity", "sh"):
                theirs = tensors[key].cpu().numpy()
                assert tensors[key].is_cuda and theirs.tobytes() == np.asarray(getattr(scene, key)).tobytes(), key
            assert ("window" in tensors) == (name == "windows")
            if scene.window is not None:
                assert (tensors["window"].cpu().numpy() == scene.window).all()
            assert tensors["mean_t"].cpu().numpy().tobytes() == scene.mean_t.astype(np.float32).tobytes()

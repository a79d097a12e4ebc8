# SPDX-License-Identifier: Apache-2.0
"""Checkpoints give the scene that a 3DGS PLY of the same numbers gives."""

import collections
import io
import os
import pathlib
import pickle
import re
import sys
import types
import zipfile
from typing import Any, Dict, List, Tuple

import numpy as np
import pytest
from conftest import tool

import l4dcodec as l4d
from l4dcodec.torch_file import Lazy, TorchFile

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")
ATTRIBUTES = ("position", "mean_t", "log_scale", "rotor", "opacity", "sh")
Arrays = Dict[str, Any]


@pytest.fixture(scope="module")
def frames(folder: pathlib.Path, tmp_path_factory: pytest.TempPathFactory) -> List[pathlib.Path]:
    """3DGS PLYs of the tool, at 0, 1/30 .. seconds."""
    path = tmp_path_factory.mktemp("frames")
    tool("slice", folder / "scene.l4d", "--from", 0, "--to", 0.2, "--fps", 30, "-o", path / "f_%02d.ply")
    return sorted(path.glob("f_*.ply"))


def gsplat_of(path: pathlib.Path) -> Arrays:
    """The parameters that gsplat would have of a PLY, in the order of its state dictionary."""
    header, _, data = path.read_bytes().partition(b"end_header\n")
    names = [line.split()[2].decode() for line in header.splitlines() if line.startswith(b"property float")]
    rows = dict(zip(names, np.frombuffer(data, "<f4").reshape(-1, len(names)).T))

    def columns(prefix: str) -> Any:
        found = sorted((name for name in rows if name.startswith(prefix)), key=lambda name: int(name.rsplit("_", 1)[1]))
        return np.stack([rows[name] for name in found], axis=1)

    count = len(rows["x"])
    return {"means": np.stack([rows[axis] for axis in "xyz"], axis=1), "opacities": rows["opacity"].copy(),
            "quats": columns("rot_"), "scales": columns("scale_"), "sh0": columns("f_dc_")[:, None],
            "shN": np.ascontiguousarray(columns("f_rest_").reshape(count, 3, -1).transpose(0, 2, 1))}


def tiny(first: int = 0) -> Arrays:
    """Four Gaussians of gsplat, the first of which is at x = first."""
    means = np.zeros((4, 3), np.float32)
    means[:, 0] = np.arange(first, first + 4)
    return {"means": means, "opacities": np.zeros(4, np.float32), "quats": np.eye(4, dtype=np.float32),
            "scales": np.full((4, 3), -2, np.float32), "sh0": np.zeros((4, 1, 3), np.float32),
            "shN": np.zeros((4, 3, 3), np.float32)}


def splatfacto_of(splats: Arrays) -> Arrays:
    named = {"features_dc": splats["sh0"][:, 0], "features_rest": splats["shN"], "means": splats["means"],
             "scales": splats["scales"], "quats": splats["quats"], "opacities": splats["opacities"][:, None]}
    return {"step": 29999, "pipeline": {f"_model.gauss_params.{name}": array for name, array in named.items()},
            "optimizers": {}}


def same(scene: l4d.Scene, expected: l4d.Scene) -> None:
    assert scene.timeline == expected.timeline and len(scene) > 100
    for name in ATTRIBUTES:
        assert np.array_equal(getattr(scene, name), getattr(expected, name)), name
    assert scene.opacity_logit == expected.opacity_logit


def test_arrays_give_the_scene_of_the_ply(frames: List[pathlib.Path]) -> None:
    splats, expected = gsplat_of(frames[2]), l4d.read(frames[2], seconds=2, fps=25)
    scene = l4d.read_checkpoint({"step": 7, "splats": splats}, seconds=2, fps=25)
    same(scene, expected)
    assert scene.source == "gsplat" and scene.rendering["compensation"] == 0
    assert l4d.read_checkpoint(splats, antialiased=True).rendering["compensation"] == 1
    scene = l4d.read_checkpoint(splatfacto_of(splats), seconds=2, fps=25)
    same(scene, expected)
    assert scene.source == "splatfacto" and any("opacity varies" in note for note in scene.notes)


def test_degrees(frames: List[pathlib.Path]) -> None:
    splats = gsplat_of(frames[0])
    for degree in range(3):
        cut = {**splats, "shN": splats["shN"][:, :(degree + 1) ** 2 - 1]}
        assert l4d.read_checkpoint(cut).sh_degree == degree
    # splatfacto without directional colours trains logits of colours.
    flat = splatfacto_of({**splats, "shN": splats["shN"][:, :0]})
    colors = 0.5 + 0.28209479177387814 * l4d.read_checkpoint(flat).sh[:, 0]
    logits = splats["sh0"][:, 0].astype(np.float64)
    assert np.abs(colors - 1 / (1 + np.exp(-logits))).max() < 1e-6


def test_a_list_is_a_sequence(frames: List[pathlib.Path], tmp_path: pathlib.Path) -> None:
    scene = l4d.read_checkpoint([gsplat_of(path) for path in frames], fps=30, match="content", position=0.1)
    expected = l4d.read_frames(frames, fps=30, match="content", position=0.1)
    assert scene.timeline.num_frames == len(frames) == 6
    same(scene, expected)
    l4d.encode(scene, tmp_path / "clip.l4d")
    assert len(l4d.open(tmp_path / "clip.l4d").slice(0.1)) > 100
    with pytest.raises(TypeError, match="match"):
        l4d.read_checkpoint(gsplat_of(frames[0]), match="order")


def test_what_is_wrong_is_named(frames: List[pathlib.Path], tmp_path: pathlib.Path) -> None:
    splats = gsplat_of(frames[0])
    for change, message in (({"quats": splats["quats"][:-1]}, "`quats` is"), ({"scales": None}, "`scales` is"),
                            ({"shN": splats["shN"][:, :4]}, "`shN`, the spherical harmonics, is"),
                            ({"sh0": splats["sh0"].T}, r"`sh0` is \[3, 1, \d+\]; (\d+) Gaussians need \[\1, 1, 3\]"),
                            ({"means": splats["means"].T}, r"`means` is \[3, \d+\]; it must be \[N, 3\]"),
                            ({"means": None}, r"`means` is \[\]"), ({"quats": "x"}, "`quats` is no array")):
        with pytest.raises(l4d.Error, match=message):
            l4d.read_checkpoint({**splats, **change})
    with pytest.raises(l4d.Error, match="from a network"):
        l4d.read_checkpoint({"splats": {"means": splats["means"], "features": splats["means"]}})
    with pytest.raises(l4d.Error, match="it has epoch, model"):
        l4d.read_checkpoint({"model": {}, "epoch": 3})
    with pytest.raises(l4d.Error, match="no file of torch.save"):
        l4d.read_checkpoint(frames[0])
    with zipfile.ZipFile(tmp_path / "other.zip", "w") as archive:
        archive.writestr("x", "y")
    with pytest.raises(l4d.Error, match="not of torch.save"):
        l4d.read_checkpoint(tmp_path / "other.zip")
    with pytest.raises(FileNotFoundError):
        l4d.read_checkpoint(tmp_path / "absent.pt")


def words_of_time() -> List[str]:
    """Those by which the reader of PLYs knows a column about time."""
    source = pathlib.Path(os.environ["L4D_SOURCE"], "io", "ply", "unread_time.cc").read_text()
    body = source[source.index("bool speaks_of_time"):source.index("std::transform")]
    return re.findall(r'"(\w+)"', body)


@pytest.mark.parametrize("key", [*words_of_time(), "times", "durations", "velocities", "ts", "scales_t", "quats_r", "_t",
                                 "Motion_coeffs", "mean_time", "deformation"])
def test_what_is_about_time_is_refused(key: str) -> None:
    splats = tiny()
    named = rf"\b{key}(, [\w.]+)*: a static scene without them would be another scene"
    given = splatfacto_of(splats)
    given["pipeline"][f"_model.gauss_params.{key}"] = np.zeros((4, 1))
    beside = splatfacto_of(splats)
    beside["pipeline"][f"_model.{key}.weight"] = np.zeros((64, 64))
    contents: List[Arrays] = [{**splats, key: np.zeros((4, 3))}, {"splats": {**splats, key: np.zeros(1)}}, given,
                              {"splats": splats, key: {"weight": np.zeros((64, 64))}}]
    for content in contents:
        with pytest.raises(l4d.Error, match=named) as caught:
            l4d.read_checkpoint(content)
        assert caught.value.status == l4d.Status.FEATURE_UNSUPPORTED
    with pytest.raises(l4d.Error, match=rf"keys _model\.{key}\.weight: a static scene"):
        l4d.read_checkpoint(beside)


def test_what_else_is_not_read_is_noted() -> None:
    splats, other = tiny(), splatfacto_of(tiny())
    features = {"features": np.zeros((4, 32)), "radii": np.zeros(4)}
    note = "2 of 8 properties were not read: features, radii."
    assert note in l4d.read_checkpoint({"splats": {**splats, **features}, "step": 1, "time": 3.5}).notes
    other["pipeline"].update({f"_model.gauss_params.{key}": array for key, array in features.items()})
    other["pipeline"].update({"_model.lpips.net.weight": np.zeros(9), "datamanager.time_cameras": np.zeros(9)})
    with pytest.warns(UserWarning, match=note):
        assert note in l4d.read_checkpoint(other).notes
    # The first of splatfacto had no gauss_params.
    old = {key.replace("gauss_params.", ""): value for key, value in other["pipeline"].items()}
    assert note in l4d.read_checkpoint({"pipeline": {**old, "_model.background": np.zeros(3)}}).notes
    notes = l4d.read_checkpoint([splats, {**splats, "radii": np.zeros(4)}, {**splats, "radii": np.ones(4)}]).notes
    assert "In 2 of 3 frames, first in frame 000001.ply: 1 of 7 properties were not read: radii." in notes


def test_several_models_are_refused() -> None:
    one = splatfacto_of(tiny())["pipeline"]
    both = {key.replace("gauss_params", f"all_models.{name}.gauss_params"): value
            for name in ("bg", "obj1") for key, value in one.items()}
    with pytest.raises(l4d.Error, match=r"2 models.*all_models\.bg\.gauss_params\.\*, .*\.obj1\.gauss_params\.\*"):
        l4d.read_checkpoint({"pipeline": both})
    # One of them alone is a scene.
    assert len(l4d.read_checkpoint({"pipeline": {key: value for key, value in both.items() if "obj1" in key}})) == 4


# ---- files ---------------------------------------------------------------------------------------------------


class Storage:
    """Numbers in a file, of which tensors are views."""

    def __init__(self, key: str, kind: type, data: bytes) -> None:
        self.key, self.kind, self.data = key, kind, data


class Tensor:
    def __init__(self, storage: Storage, offset: int, size: Any, stride: Any) -> None:
        self.arguments: Tuple[Any, ...] = storage, offset, tuple(size), tuple(stride), False, collections.OrderedDict()

    def __reduce__(self) -> Any:
        return sys.modules["torch._utils"]._rebuild_tensor_v2, self.arguments


@pytest.fixture
def torch_names(monkeypatch: pytest.MonkeyPatch) -> Dict[str, Any]:
    """The names that files of torch.save refer to, for the pickle module."""
    torch, utils = types.ModuleType("torch"), types.ModuleType("torch._utils")
    torch._utils = utils  # type: ignore[attr-defined]

    def _rebuild_tensor_v2(*_: Any) -> None:
        raise AssertionError("it is never called")

    _rebuild_tensor_v2.__module__, _rebuild_tensor_v2.__qualname__ = "torch._utils", "_rebuild_tensor_v2"
    utils._rebuild_tensor_v2 = _rebuild_tensor_v2  # type: ignore[attr-defined]
    for name in ("FloatStorage", "BFloat16Storage", "HalfStorage"):
        setattr(torch, name, type(name, (), {"__module__": "torch"}))
    monkeypatch.setitem(sys.modules, "torch", torch)
    monkeypatch.setitem(sys.modules, "torch._utils", utils)
    return vars(torch)


def save(path: pathlib.Path, content: Any, storages: List[Storage]) -> None:
    """Writes what torch.save writes."""

    class Pickler(pickle.Pickler):
        def persistent_id(self, item: Any) -> Any:
            if isinstance(item, Storage):
                return "storage", item.kind, item.key, "cpu", len(item.data)
            return None

    out = io.BytesIO()
    Pickler(out, protocol=2).dump(content)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("archive/data.pkl", out.getvalue())
        for storage in storages:
            archive.writestr(f"archive/data/{storage.key}", storage.data)


def save_gsplat(path: pathlib.Path, splats: Arrays, torch_names: Dict[str, Any]) -> None:
    """Writes what gsplat's trainer writes."""
    tensors: Arrays = {}
    storages: List[Storage] = []
    for name, array in splats.items():
        storages.append(Storage(str(len(storages)), torch_names["FloatStorage"], array.astype("<f4").tobytes()))
        strides = [step // 4 for step in np.ascontiguousarray(array).strides]
        tensors[name] = Tensor(storages[-1], 0, array.shape, strides)
    save(path, {"step": 6999, "splats": collections.OrderedDict(tensors)}, storages)


def test_files_are_read_without_torch(frames: List[pathlib.Path], tmp_path: pathlib.Path,
                                      torch_names: Dict[str, Any]) -> None:
    save_gsplat(tmp_path / "ckpt.pt", gsplat_of(frames[1]), torch_names)
    same(l4d.read_checkpoint(tmp_path / "ckpt.pt"), l4d.read(frames[1]))
    ones = Storage("0", torch_names["BFloat16Storage"], b"\x80\x3f\x00\xc0\x40\x3f")
    save(tmp_path / "half.pt", [Tensor(ones, 0, (3,), (1,)), Tensor(ones, 1, (2, 1), (1, 5))], [ones])
    file = TorchFile(tmp_path / "half.pt")
    assert [file.array(tensor).tolist() for tensor in file.content] == [[1, -2, 0.75], [[-2], [0.75]]]


def test_ranks_of_a_step_are_one_scene(tmp_path: pathlib.Path, torch_names: Dict[str, Any]) -> None:
    def path(step: int, rank: int) -> pathlib.Path:
        return tmp_path / f"ckpt_{step}_rank{rank}.pt"

    for step in (6999, 29999):
        for rank in range(2):
            save_gsplat(path(step, rank), tiny(4 * rank), torch_names)
    note = "The Gaussians of 2 ranks of one step were joined."
    for rank in range(2):
        scene = l4d.read_checkpoint(path(29999, rank), seconds=2)
        assert scene.position[:, 0].tolist() == list(range(8)) and note in scene.notes
    # In a list they are one frame; other steps, and a rank that comes again, are others.
    a, b = path(6999, 0), path(29999, 0)
    for listed, count in (([a], 1), ([a, path(6999, 1)], 1), ([b, a, path(6999, 1), path(29999, 1)], 2), ([a, b, a], 3)):
        scene = l4d.read_checkpoint(listed, match="order")
        assert (scene.timeline.num_frames, len(scene)) == (count, 8)
        assert f"In {count} of {count} frames, first in frame 000000.ply: {note}" in scene.notes
    save_gsplat(path(29999, 3), tiny(), torch_names)
    with pytest.raises(l4d.Error, match="ckpt_29999_rank2.pt is not beside it; the ranks 0 to 3 have one scene"):
        l4d.read_checkpoint(path(29999, 0))
    with pytest.raises(FileNotFoundError, match="rank7"):
        l4d.read_checkpoint([path(6999, 7)])
    save_gsplat(path(29999, 2), {**tiny(), "shN": np.zeros((4, 0, 3))}, torch_names)
    with pytest.raises(l4d.Error, match="rank2.pt: spherical harmonics of another degree than .*rank0.pt"):
        l4d.read_checkpoint(path(29999, 0))
    path(1, 0).write_bytes(path(6999, 0).read_bytes())
    assert len(l4d.read_checkpoint(path(1, 0))) == 4  # alone it is a whole scene


def test_damaged_files_are_refused(tmp_path: pathlib.Path, torch_names: Dict[str, Any]) -> None:
    data = Storage("0", torch_names["FloatStorage"], bytes(40))
    for offset, size, stride in ((0, (11,), (1,)), (8, (3,), (1,)), (0, (10,), (-1,)), (-1, (2,), (1,)),
                                 (0, (1000, 1000), (0, 0)), (0, (2,), (1, 1))):
        save(tmp_path / "x.pt", {"means": Tensor(data, offset, size, stride)}, [data])
        file = TorchFile(tmp_path / "x.pt")
        with pytest.raises(l4d.Error) as caught:
            file.array(file.content["means"])
        assert caught.value.status == l4d.Status.CORRUPT
    whole = (tmp_path / "x.pt").read_bytes()
    for end in range(4, len(whole), 7):
        (tmp_path / "cut.pt").write_bytes(whole[:end])
        with pytest.raises(l4d.Error):
            l4d.read_checkpoint(tmp_path / "cut.pt")


def test_nothing_of_a_file_is_run(tmp_path: pathlib.Path) -> None:
    class Attack:
        def __reduce__(self) -> Any:
            return exec, (f"open({str(tmp_path / 'ran')!r}, 'w')",)

    save(tmp_path / "x.pt", {"splats": Attack(), "other": [Attack(), {"x": Attack()}]}, [])
    with pytest.raises(l4d.Error, match="it has other, splats"):
        l4d.read_checkpoint(tmp_path / "x.pt")
    assert not (tmp_path / "ran").exists()


def test_files_of_torch(frames: List[pathlib.Path], tmp_path: pathlib.Path) -> None:
    torch = pytest.importorskip("torch")
    splats, expected = gsplat_of(frames[3]), l4d.read(frames[3])
    parameters = torch.nn.ParameterDict({name: torch.nn.Parameter(torch.from_numpy(a)) for name, a in splats.items()})
    torch.save({"step": 6999, "splats": parameters.state_dict()}, tmp_path / "gsplat.pt")
    same(l4d.read_checkpoint(tmp_path / "gsplat.pt"), expected)
    torch.save({"splats": dict(parameters)}, tmp_path / "parameters.pt")
    same(l4d.read_checkpoint(tmp_path / "parameters.pt"), expected)
    same(l4d.read_checkpoint({"splats": parameters.state_dict()}), expected)

    adam = torch.optim.Adam(list(parameters.values()))
    sum(p.sum() for p in parameters.values()).backward()
    adam.step()
    numbers = splatfacto_of({name: p.detach() for name, p in parameters.items()})
    numbers["optimizers"] = {"means": adam.state_dict()}
    numbers["scalers"] = types.SimpleNamespace(scale=65536.0, dtype=torch.float16, path=pathlib.PurePosixPath("x"))
    torch.save(numbers, tmp_path / "step-000029999.ckpt")
    trained = l4d.read_checkpoint(tmp_path / "step-000029999.ckpt")
    same(trained, l4d.read_checkpoint({"splats": {name: p.detach() for name, p in parameters.items()}}))
    assert np.abs(trained.position - expected.position).max() > 1e-4
    content = TorchFile(tmp_path / "step-000029999.ckpt").content
    assert content["step"] == 29999 and isinstance(content["pipeline"]["_model.gauss_params.means"], Lazy)

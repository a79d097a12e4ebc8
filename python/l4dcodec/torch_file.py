# SPDX-License-Identifier: Apache-2.0
"""Tensors of files that torch.save has written, without PyTorch. Nothing of a file is run: what is no tensor, number,
text or container is an Opaque."""

import collections
import io
import math
import pickle
import zipfile
from typing import Any, Dict, List, Tuple

import numpy as np
import numpy.typing as npt

from .core import Error, Path, Status

# Bytes of a number and its type; bfloat16 is the upper half of a float32.
STORAGES = {"FloatStorage": "<f4", "DoubleStorage": "<f8", "HalfStorage": "<f2", "BFloat16Storage": "bfloat16",
            "LongStorage": "<i8", "IntStorage": "<i4", "ShortStorage": "<i2", "CharStorage": "i1",
            "ByteStorage": "u1", "BoolStorage": "?"}


class Opaque:
    """What a file has that is not understood. It takes whatever the file says of it."""

    def __init__(self, *_: Any, **__: Any) -> None:
        pass

    def __setstate__(self, state: Any) -> None:
        pass

    def __setitem__(self, key: Any, value: Any) -> None:
        pass

    def append(self, value: Any) -> None:
        """Of a list that is none here."""

    def extend(self, values: Any) -> None:
        """Of a list that is none here."""


class Lazy:
    """A tensor that is still in the file."""

    def __init__(self, storage: Tuple[Any, ...], offset: int, size: Tuple[int, ...], stride: Tuple[int, ...]) -> None:
        self.storage, self.offset, self.size, self.stride = storage, offset, size, stride


def _tensor(storage: Any, offset: int, size: Any, stride: Any, *_: Any) -> Lazy:
    return Lazy(storage, offset, size, stride)


def _parameter(data: Any, *_: Any) -> Any:
    return data


def _ordered(*arguments: Any) -> Dict[Any, Any]:
    return _Dict(*arguments)


class _Dict(collections.OrderedDict):  # type: ignore[type-arg]
    """State dictionaries have attributes as well."""

    def __setstate__(self, state: Any) -> None:
        pass


KNOWN = {("collections", "OrderedDict"): _ordered, ("torch._utils", "_rebuild_tensor_v2"): _tensor,
         ("torch._utils", "_rebuild_tensor"): _tensor, ("torch._utils", "_rebuild_parameter"): _parameter}


class _Unpickler(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        if module == "torch" and name.endswith("Storage"):
            return name
        return KNOWN.get((module, name), Opaque)

    def persistent_load(self, pid: Any) -> Any:
        return tuple(pid)


class TorchFile:
    """An open file. `content` is what torch.load returns, with Lazy in place of tensors."""

    def __init__(self, path: Path) -> None:
        self._path = path
        with open(path, "rb") as file:
            if file.read(4) != b"PK\x03\x04":
                raise Error(Status.FEATURE_UNSUPPORTED, f"{path}: no file of torch.save, or one of before PyTorch 1.6: "
                            "load it in PyTorch and save it again")
        try:
            self._zip = zipfile.ZipFile(path)
            pickled = [name for name in self._zip.namelist() if name.endswith("/data.pkl")]
            if len(pickled) != 1:
                raise Error(Status.FEATURE_UNSUPPORTED, f"{path}: a ZIP archive, and not of torch.save")
            self._folder = pickled[0][:-len("data.pkl")]
            if self._folder + "byteorder" in self._zip.namelist():
                if self._zip.read(self._folder + "byteorder") != b"little":
                    raise Error(Status.FEATURE_UNSUPPORTED, f"{path}: written by a big-endian machine")
            self.content = _Unpickler(io.BytesIO(self._zip.read(pickled[0]))).load()
        except Error:
            raise
        except Exception as error:  # damaged pickles raise anything
            raise Error(Status.CORRUPT, f"{path}: {error}") from error

    def close(self) -> None:
        """Closes the file."""
        self._zip.close()

    def array(self, tensor: Lazy) -> npt.NDArray[Any]:
        """The numbers of a tensor, in its shape."""
        try:
            _, kind, key, *_ = tensor.storage
            name = STORAGES[kind]
            member = self._zip.getinfo(f"{self._folder}data/{key}")
            if member.compress_type != zipfile.ZIP_STORED:
                raise ValueError("numbers are compressed")
            data = np.frombuffer(self._zip.read(member), "<u2" if name == "bfloat16" else name)
            size, stride = [int(n) for n in tensor.size], [int(n) for n in tensor.stride]
            last = tensor.offset + sum((n - 1) * step for n, step in zip(size, stride))
            if len(size) != len(stride) or min([0, tensor.offset, *size, *stride]) < 0 or (
                    0 not in size and (last >= len(data) or math.prod(size) > len(data))):
                raise ValueError(f"a tensor {size} of a storage of {len(data)} numbers")
        except Exception as error:
            raise Error(Status.CORRUPT, f"{self._path}: {error!r}") from error
        if 0 in size:
            return np.zeros(size, np.float32)
        steps: List[int] = [step * data.itemsize for step in stride]
        view = np.lib.stride_tricks.as_strided(data[tensor.offset:], size, steps, writeable=False)
        if name == "bfloat16":
            return (view.astype(np.uint32) << 16).view(np.float32)
        return view

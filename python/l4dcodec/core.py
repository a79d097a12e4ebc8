# SPDX-License-Identifier: Apache-2.0
"""What the classes of this package share: statuses, sources of bytes, callbacks, and borrowed arrays.

The other modules call C through `lib` and `ffi` of this one.
"""

import concurrent.futures
import enum
import mmap
import numbers
import os
import warnings
from typing import Any, Callable, Dict, List, Mapping, Optional, Protocol, Tuple, Union, runtime_checkable

import numpy as np
import numpy.typing as npt

from . import arguments as given
from ._native import ffi as ffi
from ._native import lib as lib

Floats = npt.NDArray[np.float32]
Path = Union[str, "os.PathLike[str]"]
Progress = Callable[[int, int, str], object]
"""Called between the steps of a long call, as (done, total, stage)."""


@runtime_checkable
class Reader(Protocol):
    """Random access to the bytes of a file. An attribute `block_bytes`, if there is one, says how many bytes
    take as long as one more read: 65536 suits most networks."""

    def read_at(self, offset: int, size: int) -> bytes:
        """Returns `size` bytes from `offset` on, and fewer only at the end of the file."""
        ...

    def size(self) -> int:
        """Returns the number of bytes of the file."""
        ...


Source = Union[Path, bytes, bytearray, memoryview, mmap.mmap, Reader]
"""A path, the bytes of a file (or an mmap of it), or a Reader."""


class Status(enum.IntEnum):
    """Why a call failed. l4d.h describes each, with L4D_ERR_ before its name."""

    OK = 0
    INVALID_ARGUMENT = lib.L4D_ERR_INVALID_ARGUMENT
    INVALID_STATE = lib.L4D_ERR_INVALID_STATE
    OUT_OF_MEMORY = lib.L4D_ERR_OUT_OF_MEMORY
    IO = lib.L4D_ERR_IO
    CANCELLED = lib.L4D_ERR_CANCELLED
    LIMIT_EXCEEDED = lib.L4D_ERR_LIMIT_EXCEEDED
    INVALID_SCENE = lib.L4D_ERR_INVALID_SCENE
    BUFFER_TOO_SMALL = lib.L4D_ERR_BUFFER_TOO_SMALL
    NEED_DATA = lib.L4D_ERR_NEED_DATA
    NOT_L4D = lib.L4D_ERR_NOT_L4D
    VERSION_UNSUPPORTED = lib.L4D_ERR_VERSION_UNSUPPORTED
    FEATURE_UNSUPPORTED = lib.L4D_ERR_FEATURE_UNSUPPORTED
    TRUNCATED = lib.L4D_ERR_TRUNCATED
    CORRUPT = lib.L4D_ERR_CORRUPT
    CHECKSUM = lib.L4D_ERR_CHECKSUM
    DEVICE = lib.L4D_ERR_DEVICE
    INTERNAL = lib.L4D_ERR_INTERNAL


class Error(Exception):
    """A call of the library failed. `status` says why, and the text names the clause and byte of a damaged
    stream, or the argument or limit and its allowed values."""

    def __init__(self, status: int, message: str) -> None:
        super().__init__(message or text(lib.l4d_status_description(status)))
        self.status = Status(status)

    def __str__(self) -> str:
        return f"{self.status.name}: {self.args[0]}"


class ArgumentError(Error, ValueError):
    """An argument has a value that it must not have."""

    def __init__(self, message: str) -> None:
        super().__init__(Status.INVALID_ARGUMENT, message)


def text(chars: Any) -> str:
    """A string of C."""
    return str(ffi.string(chars).decode("utf-8", "replace"))


def struct(name: str, **fields: Any) -> Any:
    """A struct of C with its defaults, and `fields` in place of some of them."""
    out = ffi.new(f"l4d_{name}*")
    out.struct_size = ffi.sizeof(out[0])
    for key, value in fields.items():
        put(out, key, value)
    return out


def put(target: Any, name: str, value: Any, of: str = "") -> None:
    """Sets a field of a struct of C. A value that it does not hold is told by the field's name, behind `of`."""
    try:
        setattr(target, name, value)
    except (TypeError, OverflowError, ValueError) as error:
        kind = _type_of(target, name)
        wanted = "numbers" if kind.kind == "array" else "a number"
        if kind.kind == "primitive" and "int" in kind.cname:
            bits, signed = 8 * ffi.sizeof(kind), not kind.cname.startswith("uint")
            wanted = f"a whole number from {-2**(bits - 1) if signed else 0} to {2**(bits - signed) - 1}"
        tell = given.wrong_type if isinstance(error, TypeError) else given.wrong_value
        raise tell(of + name, value, wanted) from None


def _type_of(target: Any, name: str) -> Any:
    kind = ffi.typeof(target)
    return dict((kind.item if kind.kind == "pointer" else kind).fields)[name].type


def check(status: int) -> None:
    """Raises Error unless `status` is 0."""
    if status != 0:
        raise _last_error(status)


def _last_error(status: int) -> Error:
    message = text(lib.l4d_last_error_message())
    return ArgumentError(message) if status == Status.INVALID_ARGUMENT else Error(status, message)


def path_bytes(path: Path, name: str = "path") -> bytes:
    given.of_type(name, path, (str, bytes, os.PathLike), "a path")
    return c_string(os.fsencode(path), name)


def c_string(value: Union[str, bytes], name: str) -> bytes:
    """A string for C, which ends at the first NUL: raises Error if it has one before its end."""
    given.of_type(name, value, (str, bytes), "a string")
    out = value.encode() if isinstance(value, str) else value
    if b"\0" in out:
        raise ArgumentError(f"`{name}` holds a NUL: {out!r}")
    return out


def array_of(what: str, values: Any, shape: Tuple[int, ...], dtype: Any) -> npt.NDArray[Any]:
    """A contiguous array of this shape and type with these values. Raises Error if they have another shape, are no
    numbers, or are such as an integer type does not hold."""
    if isinstance(values, np.ma.MaskedArray) and np.any(values.mask):
        raise ArgumentError(f"`{what}` has masked values")
    has, wanted = as_array(what, values), np.dtype(dtype)
    if has.shape != shape:
        raise ArgumentError(f"`{what}` has the shape {list(has.shape)}, not {list(shape)}")
    if has.dtype.kind not in ("iu" if wanted.kind in "iu" else "iufb") and has.size > 0:
        raise ArgumentError(f"`{what}` is of {has.dtype}, not of {wanted}")
    if wanted.kind in "iu" and has.size > 0:
        limits = np.iinfo(wanted)
        if int(has.min()) < limits.min or int(has.max()) > limits.max:
            raise ArgumentError(f"`{what}` is from {has.min()} to {has.max()}, which {wanted} does not hold")
    with np.errstate(over="ignore"):  # what becomes infinite is refused by its number
        return np.ascontiguousarray(has, wanted)


def as_array(what: str, values: Any) -> npt.NDArray[Any]:
    """An array of any shape."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # lists of several lengths, of which older NumPy makes objects
            return np.asarray(values)
    except Exception as error:
        raise given.wrong_type(what, values, f"an array of numbers ({error})") from None


def floats(what: str, values: Any, count: int) -> List[float]:
    """`count` numbers."""
    if isinstance(values, (str, bytes)) or not hasattr(values, "__len__"):
        raise given.wrong_type(what, values, f"{count} numbers")
    return [float(x) for x in array_of(what, values, (count,), np.float64)]


def interruptible(run: Callable[[], None], cancel: Any) -> None:
    """Runs a call of the library on another thread; this one waits, so that it hears Ctrl-C and sets cancel[0]."""
    with concurrent.futures.ThreadPoolExecutor(1) as pool:
        # The thread is there before it has work: the pool waits for it, wherever Ctrl-C interrupts what follows.
        pool.submit(int).result()
        try:
            pool.submit(run).result()
        except BaseException:
            cancel[0] = 1
            raise


def borrow(pointer: Any, shape: Tuple[int, ...], dtype: str, owner: object) -> Any:
    """An array over memory of the library, without a copy. It keeps `owner`, whose memory that is."""
    if pointer == ffi.NULL or 0 in shape:
        return np.zeros(shape, dtype)

    class Memory:
        __array_interface__ = {"version": 3, "shape": shape, "typestr": np.dtype(dtype).str,
                               "data": (int(ffi.cast("uintptr_t", pointer)), False)}
        kept = owner

    return np.asarray(Memory())


def pointer(array: Optional[npt.NDArray[Any]], ctype: str = "float*") -> Any:
    """The memory of a contiguous array; NULL for None. The caller keeps the array."""
    return ffi.NULL if array is None else ffi.cast(ctype, array.ctypes.data)


UNSEEN = ("struct_size", "reserved", "reserved2")
"""Fields of structs that say nothing."""


class Record(Dict[str, Any]):
    """The fields of a struct of the C library, as a dict and as attributes."""

    def __getattr__(self, name: str) -> Any:
        try:
            return self[name]
        except KeyError:
            raise AttributeError(f"no field {name!r}; there are {', '.join(self)}") from None


def record(value: Any) -> Any:
    """What a value of C is in Python: structs are Records, arrays are tuples, strings are str."""
    kind = ffi.typeof(value) if isinstance(value, ffi.CData) else None
    if kind is None:
        return value
    if kind.kind == "pointer" and kind.item.kind == "struct" and value != ffi.NULL:
        value, kind = value[0], kind.item
    if kind.kind == "array":
        return tuple(record(item) for item in value)
    if kind.kind != "struct":
        return None if value == ffi.NULL else text(value)
    names = [name for name, _ in kind.fields if name not in UNSEEN]
    return Record((name, record(getattr(value, name))) for name in names)


def set_fields(target: Any, fields: Mapping[str, Any], what: str) -> None:
    """Writes a Record, an argument `what`, back to its struct. Fields that it lacks stay as they are."""
    types = dict(ffi.typeof(target[0] if ffi.typeof(target).kind == "pointer" else target).fields)
    names = [name for name in types if name not in UNSEEN]
    for name, value in given.mapping(what, fields, "a mapping with some of " + ", ".join(names)).items():
        if name not in types:
            raise ArgumentError(f"`{what}` has no field `{name}`; it has {', '.join(names)}")
        if types[name].type.kind == "array":
            value = floats(f"{what}.{name}", value, types[name].type.length)
        put(target, name, value, f"{what}.")


# ---- callbacks ------------------------------------------------------------------------------------------


class Call:
    """What Python code does while C runs. It keeps the exception that ended it until the call returns."""

    def __init__(self, progress: Optional[Progress] = None, write: Optional[Callable[[bytes], object]] = None,
                 reader: Optional[Reader] = None) -> None:
        self.progress, self.write, self.reader = given.progress(progress), write, reader
        self.violations: List["Violation"] = []
        self.error: Optional[BaseException] = None

    def handle(self) -> Any:
        """What C passes to the callbacks. The caller keeps it as long as C has it."""
        return ffi.new_handle(self)

    def check(self, status: int) -> None:
        """As check(). An exception of the Python code is raised again, or becomes the cause of the Error."""
        error, self.error = self.error, None
        # Ctrl-C ends a tolerant call as well, which goes on where a reader fails.
        if error is not None and (status == Status.CANCELLED or not isinstance(error, Exception)):
            raise error
        if status == 0:
            return
        raise _last_error(status) from error


def write_all(write: Callable[[bytes], object], data: bytes) -> None:
    """Writes until all is written: an unbuffered file takes what it can at once, and says how much that was."""
    while data:
        taken = write(data)
        if not isinstance(taken, numbers.Integral) or not 0 < int(taken) <= len(data):
            raise OSError(f"write() of {len(data)} bytes returned {taken!r}, not how many it took")
        data = data[int(taken):]


class Violation:
    """A rule of the format that a file breaks: `clause`, its id; `offset`, a byte, or None; `message`."""

    def __init__(self, status: int, clause: str, offset: Optional[int], message: str) -> None:
        self.status, self.clause, self.offset, self.message = Status(status), clause, offset, message

    def __repr__(self) -> str:
        return f"<{self.clause or self.status.name} at byte {self.offset}: {self.message}>"


def _keep(kind: object, error: BaseException, trace: Any) -> None:
    # The frame is that of the callback, whose first argument is the handle.
    ffi.from_handle(trace.tb_frame.f_locals["user"]).error = error


@ffi.def_extern(error=1, onerror=_keep)  # type: ignore[misc]
def l4dpy_progress(user: Any, done: int, total: int, stage: Any) -> int:
    progress = ffi.from_handle(user).progress
    if progress is not None:
        progress(done, total, text(stage))
    return 0


@ffi.def_extern(error=1, onerror=_keep)  # type: ignore[misc]
def l4dpy_write(user: Any, data: Any, n: int) -> int:
    write_all(ffi.from_handle(user).write, ffi.buffer(data, n)[:])
    return 0


@ffi.def_extern(error=-1, onerror=_keep)  # type: ignore[misc]
def l4dpy_read_at(user: Any, data: Any, n: int, offset: int) -> int:
    got = memoryview(ffi.from_handle(user).reader.read_at(offset, n)).cast("B")
    if len(got) > n:
        raise ValueError(f"read_at({offset}, {n}) returned {len(got)} bytes")
    ffi.memmove(data, got, len(got))
    return len(got)


@ffi.def_extern(error=-1, onerror=_keep)  # type: ignore[misc]
def l4dpy_size(user: Any) -> int:
    size = int(ffi.from_handle(user).reader.size())
    if not 0 <= size < 2**63:
        raise ValueError(f"size() returned {size}")
    return size


@ffi.def_extern(onerror=_keep)  # type: ignore[misc]
def l4dpy_violation(user: Any, v: Any) -> None:
    offset = None if v.offset == 2**64 - 1 else v.offset
    ffi.from_handle(user).violations.append(Violation(v.status, text(v.clause), offset, text(v.message)))


# ---- sources of bytes ------------------------------------------------------------------------------------


class _File:
    """A file by its path."""

    def __init__(self, path: Path) -> None:
        path_bytes(path)  # refuses a NUL
        self._file = os.open(path, os.O_RDONLY)

    def __del__(self) -> None:
        if hasattr(self, "_file"):
            os.close(self._file)

    def read_at(self, offset: int, size: int) -> bytes:
        return os.pread(self._file, size, offset)

    def size(self) -> int:
        return os.fstat(self._file).st_size


class _Bytes:
    def __init__(self, data: Any) -> None:
        self._data = memoryview(data).cast("B")

    def read_at(self, offset: int, size: int) -> Any:
        return self._data[offset:offset + size]

    def size(self) -> int:
        return len(self._data)


def reader_of(source: Source, name: str = "source") -> Reader:
    """A Reader of any source."""
    if isinstance(source, (str, os.PathLike)):
        return _File(source)
    if isinstance(source, Reader):
        return source
    try:
        return _Bytes(source)
    except TypeError:
        raise given.wrong_type(name, source, "a path, the bytes of a file, or an object with read_at and size") from None


def c_reader(call: Call, handle: Any) -> Any:
    """The l4d_reader of the reader of a call."""
    return struct("reader", user=handle, read_at=lib.l4dpy_read_at, size=lib.l4dpy_size,
                  block_bytes=int(getattr(call.reader, "block_bytes", 0)))

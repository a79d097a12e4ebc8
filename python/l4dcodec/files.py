# SPDX-License-Identifier: Apache-2.0
"""Whole files: their rules, the distance between two, and parts of them."""

import dataclasses
import math
from typing import Any, Dict, List, Mapping, Optional, Union

import numpy as np
import numpy.typing as npt

from . import arguments as given
from .core import (Call, Progress, Source, Violation, array_of, c_reader, check, ffi, interruptible, lib, pointer, reader_of,
                   struct, text)
from .scene import Scene, count_of, native_of


def validate(source: Source, *, threads: int = 0, max_memory_bytes: int = 0,
             progress: Optional[Progress] = None) -> List[Violation]:
    """Checks a whole file against every rule of the format. Returns the violations; an empty list if there is none.
    Time is proportional to the bytes of the file and the number of Gaussians."""
    call = Call(progress, reader=reader_of(source))
    handle = call.handle()
    options = struct("decoder_options", threads=threads, max_memory_bytes=max_memory_bytes,
                     progress=lib.l4dpy_progress, progress_user=handle)
    count = ffi.new("uint64_t*")
    call.check(lib.l4d_validate(c_reader(call, handle), options, lib.l4dpy_violation, handle, count))
    return call.violations


@dataclasses.dataclass(frozen=True)
class ErrorStatistics:
    """One error over all pairs of Gaussians. What is not measured is NaN."""

    meaning: str
    max: float
    rmse: float
    p999: float
    """99.9 % of the Gaussians have at most this error."""


@dataclasses.dataclass(frozen=True)
class Comparison:
    """How far scene B is from scene A, as `l4dcodec compare` measures it."""

    identical: bool
    """The same Gaussians bit for bit, in any order."""
    match: str
    """How Gaussians are paired: "order"; "exact", by their bits; "stated", within the errors that B states of itself;
    "unknown": not all of them, so that `errors` lacks those of single Gaussians."""
    count_a: int
    count_b: int
    matched: int
    equal_rows: int
    errors: Mapping[str, ErrorStatistics]


def compare(a: Union[Scene, Source], b: Union[Scene, Source], *, order: Optional[npt.ArrayLike] = None,
            threads: int = 0) -> Comparison:
    """Measures how far the attributes of `b` are from those of `a`. Both are scenes, PLYs or streams.

    order: EncodeReport.order, if `b` is what became of `a`. Without it, Gaussians are paired by their bits, or as
    `b`, a stream, states how far it is from its original.
    """
    indices = None if order is None else array_of("order", order, (count_of("order", order),), np.uint32)
    given.whole("threads", threads)
    first, second = native_of(a, name="a"), native_of(b, name="b")
    out, cancel = ffi.new("l4dpy_comparison*"), ffi.new("int32_t*")

    def run() -> None:
        check(lib.l4dpy_compare(first, second, pointer(indices, "uint32_t*"), 0 if indices is None else indices.size,
                                threads, cancel, out))

    interruptible(run, cancel)
    errors: Dict[str, ErrorStatistics] = {}
    for e in out.errors[0:out.num_errors]:
        errors[text(e.name)] = ErrorStatistics(text(e.meaning), e.max, e.rmse, e.p999)
    return Comparison(bool(out.identical), text(out.match), out.count_a, out.count_b, out.matched, out.equal_rows,
                      errors)

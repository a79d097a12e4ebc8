# SPDX-License-Identifier: Apache-2.0
"""Checks of arguments. Each names the argument, what was given, and what is possible."""

import math
import numbers
import os
import reprlib
from typing import Any, Mapping, Optional, Sequence

import numpy as np


def shown(value: object) -> str:
    """What was given, in a few words."""
    return f"{reprlib.repr(value)} ({type(value).__name__})"


def wrong_type(name: str, value: object, wanted: str) -> TypeError:
    return TypeError(f"`{name}` is {shown(value)}; it must be {wanted}")


def wrong_value(name: str, value: object, wanted: str) -> Exception:
    """An Error of the library that is a ValueError as well."""
    from .core import ArgumentError  # which imports this module
    return ArgumentError(f"`{name}` is {reprlib.repr(value)}; it must be {wanted}")


def number(name: str, value: Any, *, least: float = -math.inf, above: float = -math.inf, most: float = math.inf) -> float:
    """A finite number that is at least `least`, above `above`, and at most `most`."""
    wanted = "a number"
    if least > -math.inf or above > -math.inf:
        wanted += f" of at least {least:g}" if least > -math.inf else f" above {above:g}"
    if most < math.inf:
        wanted += f" and at most {most:.10g}"
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, (numbers.Real, np.ndarray)) or (
            isinstance(value, np.ndarray) and (value.ndim > 0 or value.dtype.kind not in "iuf")):
        raise wrong_type(name, value, wanted)
    try:
        out = float(value)
    except OverflowError:
        out = math.inf
    if not (math.isfinite(out) and out >= least and out > above and out <= most):
        raise wrong_value(name, value, wanted)
    return out


def whole(name: str, value: Any, *, least: int = 0, most: int = 2**32 - 1) -> int:
    """A whole number."""
    wanted = f"a whole number from {least} to {most}"
    if isinstance(value, (bool, np.bool_)) or not hasattr(value, "__index__"):
        raise wrong_type(name, value, wanted)
    try:
        out = int(value.__index__())
    except TypeError:  # arrays have one, and not all of them use it
        raise wrong_type(name, value, wanted) from None
    if not least <= out <= most:
        raise wrong_value(name, value, wanted)
    return out


def flag(name: str, value: Any) -> bool:
    """True or False, or 1 or 0."""
    if isinstance(value, (bool, np.bool_)) or (isinstance(value, numbers.Integral) and value in (0, 1)):
        return bool(value)
    raise wrong_type(name, value, "True or False")


def choice(name: str, value: Any, choices: Sequence[str]) -> str:
    wanted = "one of " + ", ".join(choices)
    if not isinstance(value, str):
        raise wrong_type(name, value, wanted)
    if value not in choices:
        raise wrong_value(name, value, wanted)
    return value


def of_type(name: str, value: Any, kind: Any, wanted: str) -> Any:
    if not isinstance(value, kind):
        raise wrong_type(name, value, wanted)
    return value


def mapping(name: str, value: Any, wanted: str) -> Mapping[str, Any]:
    """A mapping whose keys are strings."""
    of_type(name, value, Mapping, wanted)
    for key in value:
        of_type(f"a key of {name}", key, str, "a string")
    return value  # type: ignore[no-any-return]


def paths(name: str, value: Any) -> Sequence[Any]:
    """Some paths; one alone, which is a sequence of letters as well, is none."""
    wanted = "a list of paths"
    if isinstance(value, (str, bytes, os.PathLike, Mapping)) or not hasattr(value, "__iter__"):
        raise wrong_type(name, value, wanted)
    out = list(value)
    if not out:
        raise wrong_value(name, value, wanted + ", and not empty")
    return out


def progress(value: Any) -> Optional[Any]:
    if value is not None and not callable(value):
        raise wrong_type("progress", value, "None or a function of done, total and stage")
    return value

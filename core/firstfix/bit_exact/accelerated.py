"""Kernels of the compiled core in the place of NumPy functions.

The robot's part of the core runs with NumPy alone. Its hot functions are also kernels of ``firstfix.native``.
The NumPy function says what the result is, to the last bit.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any, ParamSpec, TypeVar

_P = ParamSpec("_P")
_R = TypeVar("_R")

REFERENCES: dict[str, Callable[..., Any]] = {}


def accelerated(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """The kernel of the same name, or the function itself where the compiled core is not installed.

    ``REFERENCES`` keeps the function under its name.
    """
    REFERENCES[function.__name__] = function
    kernel = getattr(_native(), function.__name__, None)
    return function if kernel is None else kernel


def _native() -> Any:
    try:
        return import_module("firstfix.native")
    except ModuleNotFoundError:  # other errors are faults: a wrong setting, a damaged file
        return None

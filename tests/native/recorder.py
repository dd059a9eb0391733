"""Record of the calls of kernels that the cases of ``kernel_cases`` make."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from types import ModuleType
from typing import Any

import firstfix.native
from tests.native import kernel_cases


@dataclass(frozen=True)
class Call:
    """A call of a kernel, a constructor or a method, that gave a result."""

    name: str
    function: Callable[..., Any]
    arguments: tuple[Any, ...]


class Recorder:
    """Stands for the module, or for one of its objects, in a case, and keeps the calls."""

    def __init__(self, real: Any, calls: list[Call], prefix: str = "") -> None:
        self._real, self._calls, self._prefix = real, calls, prefix

    def __getattr__(self, name: str) -> Any:
        function, path = getattr(self._real, name), self._prefix + name
        if isinstance(getattr(type(self._real), name, None), property):
            return function

        def call(*arguments: Any) -> Any:
            real = tuple(_real(one) for one in arguments)
            self._calls.append(Call(path, function, real))
            result = function(*real)
            made = type(result)
            is_ours = made.__module__.startswith(firstfix.native.__name__)
            return Recorder(result, self._calls, f"{made.__name__}.") if is_ours else result

        return call

    def __len__(self) -> int:
        return len(self._real)


def _real(argument: Any) -> Any:
    if isinstance(argument, list):
        return [_real(one) for one in argument]
    return argument._real if isinstance(argument, Recorder) else argument


def recorded(native: ModuleType) -> list[Call]:
    """Returns the calls of all cases."""
    calls: list[Call] = []
    for case in kernel_cases.CASES.values():
        case(Recorder(native, calls))
    return calls


def kernels(native: ModuleType) -> set[str]:
    """Returns the names of all functions and classes of the compiled core, and of the classes' methods.

    An enumeration has no code of its own, nor has a class that only functions make a constructor.
    """
    found = set()
    for name, value in vars(native).items():
        if type(value).__name__ == "nb_func":
            found.add(name)
        if isinstance(value, type) and not issubclass(value, Enum):
            methods = (
                method
                for method, code in vars(value).items()
                if not (method.startswith("_") or isinstance(code, property))
            )
            found |= {f"{name}.{method}" for method in methods}
            if type(vars(value)["__init__"]).__name__ == "nb_method":
                found.add(name)
    return found

"""Memory of a loaded version without its mapped files, which all processes share."""

from __future__ import annotations

import gc
from types import BuiltinFunctionType, FunctionType, MethodType, ModuleType

import numpy as np

_NO_DATA = (type, ModuleType, FunctionType, BuiltinFunctionType, MethodType, str, bytes, int, float)


def private_bytes(root: object) -> int:
    """Returns the bytes of all NumPy arrays reachable from an object, except arrays mapped from files.

    The pages of a mapped file are shared, and the kernel can drop them at any time.
    """
    seen: set[int] = set()
    waiting: list[object] = [root]
    total = 0
    while waiting:
        one = waiting.pop()
        if id(one) in seen or isinstance(one, _NO_DATA):
            continue
        seen.add(id(one))
        if isinstance(one, np.ndarray):
            if isinstance(one.base, np.ndarray):
                waiting.append(one.base)
            elif one.base is None:
                total += one.nbytes
        else:
            waiting.extend(gc.get_referents(one))
    return total

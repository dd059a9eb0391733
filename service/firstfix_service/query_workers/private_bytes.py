"""What a loaded version takes besides its mapped files, which all processes share."""

from __future__ import annotations

import gc
from types import BuiltinFunctionType, FunctionType, MethodType, ModuleType

import numpy as np

_NO_DATA = (type, ModuleType, FunctionType, BuiltinFunctionType, MethodType, str, bytes, int, float)


def private_bytes(root: object) -> int:
    """Bytes of the NumPy arrays that are reached from an object and lie in this process's own memory.

    Arrays mapped from a file count nothing: their pages are shared and can be dropped at any time.
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

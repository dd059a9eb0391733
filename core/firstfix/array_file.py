"""Several arrays in one file, memory-mapped when read: processes that load it share its pages.

The format is safetensors, whose own reader copies NumPy arrays; its header is simple enough to map them.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors.numpy import save

_DTYPES = {"F32": np.float32, "F64": np.float64, "I32": np.int32, "BOOL": np.bool_}
_MOST_HEADER_BYTES = 1 << 20


def save_arrays(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """float32, float64, int32 or bool; the same arrays give the same bytes."""
    path.write_bytes(save({name: np.ascontiguousarray(array) for name, array in arrays.items()}))


def map_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """Read-only, of what ``save_arrays`` wrote.

    Raises:
        ValueError: it is no such file, or cut off.
        OSError: it cannot be read.
    """
    data = np.memmap(path, np.uint8, "r")
    size = int.from_bytes(data[:8].tobytes(), "little")
    if size > min(_MOST_HEADER_BYTES, len(data) - 8):
        raise ValueError(f"{path.name} has no header")
    try:
        header = json.loads(data[8 : 8 + size].tobytes())
        header.pop("__metadata__", None)
        return {name: _mapped(data[8 + size :], entry) for name, entry in header.items()}
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise ValueError(f"{path.name}: {error}") from None


def _mapped(content: NDArray[np.uint8], entry: Mapping[str, Any]) -> NDArray[Any]:
    dtype, shape = np.dtype(_DTYPES[entry["dtype"]]), entry["shape"]
    begin, end = entry["data_offsets"]
    if not 0 <= begin <= end <= len(content) or end - begin != prod(shape) * dtype.itemsize:
        raise ValueError("an array is cut off")
    array: NDArray[Any] = np.asarray(content[begin:end]).view(dtype).reshape(shape)
    return array

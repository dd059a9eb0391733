"""Files of several arrays, memory-mapped when read: processes that load one share its pages.

The format is safetensors. Its own library copies NumPy arrays when it reads and writes, and those of a large
map are gigabytes; its header is simple enough to handle here.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

_DTYPES = {"F32": np.float32, "F64": np.float64, "I32": np.int32, "U8": np.uint8, "BOOL": np.bool_}
_NAMES = {np.dtype(dtype): name for name, dtype in _DTYPES.items()}
_MAX_HEADER_BYTES = 1 << 20


def save_arrays(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write float32, float64, int32, uint8 or bool arrays. The same arrays always give the same bytes.

    Only arrays that are not contiguous are copied.

    Raises:
        KeyError: an array has another type.
    """
    inside, entries, end = [], {}, 0
    for name in sorted(arrays, key=lambda name: (-arrays[name].itemsize, name)):  # widest first: aligned
        array = np.ascontiguousarray(arrays[name])
        begin, end = end, end + array.nbytes
        dtype = _NAMES[array.dtype]
        entries[name] = {"dtype": dtype, "shape": array.shape, "data_offsets": [begin, end]}
        inside.append(array)
    header = json.dumps(entries, separators=(",", ":")).encode()
    header += b" " * (-len(header) % 8)
    with path.open("wb") as file:
        file.write(len(header).to_bytes(8, "little") + header)
        for array in inside:
            array.tofile(file)


def map_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """Map the arrays of a file that ``save_arrays`` wrote, read-only.

    Raises:
        ValueError: the file has another format, is cut off or has an array that is not aligned.
        OSError: the file cannot be read.
    """
    data = np.asarray(np.memmap(path, np.uint8, "r"))  # views of a plain array are made quicker
    size = int.from_bytes(data[:8].tobytes(), "little")
    if size > min(_MAX_HEADER_BYTES, len(data) - 8):
        raise ValueError(f"{path.name} has no header")
    try:
        header = json.loads(data[8 : 8 + size].tobytes())
        header.pop("__metadata__", None)
        return {name: _mapped(data[8 + size :], entry) for name, entry in header.items()}
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise ValueError(f"{path.name}: {error}") from None


def check_numbers(name: str, numbers: NDArray[np.integer], end: int, *, ascending: bool = False) -> None:
    """Check that all numbers are from 0 to ``end - 1``, as the rows of a table are.

    Args:
        name: of the array, for the message.
        ascending: along the last axis no number may be less than the one before it.

    Raises:
        ValueError: they are not.
    """
    if numbers.size and not (numbers.min() >= 0 and numbers.max() < end):
        raise ValueError(f"{name} has numbers that are not from 0 to {end - 1}")
    if ascending and (numbers[..., 1:] < numbers[..., :-1]).any():
        raise ValueError(f"{name} does not ascend")


def _mapped(content: NDArray[np.uint8], entry: Mapping[str, Any]) -> NDArray[Any]:
    dtype, shape = np.dtype(_DTYPES[entry["dtype"]]), entry["shape"]
    begin, end = entry["data_offsets"]
    if not 0 <= begin <= end <= len(content) or end - begin != prod(shape) * dtype.itemsize:
        raise ValueError("an array is cut off")
    array: NDArray[Any] = np.asarray(content[begin:end]).view(dtype).reshape(shape)
    if not array.flags.aligned:
        raise ValueError("an array is not aligned")
    return array

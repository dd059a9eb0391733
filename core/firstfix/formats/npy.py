"""Reader of NumPy's .npy files: (n, >= 3) numbers, or records with fields x, y, z. It never unpickles."""

from __future__ import annotations

import io
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import MalformedData
from ..scan.scan import is_transposed
from .file_kind import kind_of
from .point_cloud import Body, Limits, PointCloud, with_axes
from .row_layout import KITTI, names_of

MAGIC = b"\x93NUMPY"
_HEAD_BYTES = 256
_MAX_HEADER_BYTES = 70_000


def read_npy(path: Path, limits: Limits) -> PointCloud:
    """Read a file. The file is memory-mapped, so that a wrong size in the header takes no memory.

    Raises:
        MalformedData, TooLarge: as ``decode_npy``.
    """
    is_empty = path.stat().st_size == 0  # which cannot be mapped
    return decode_npy(b"" if is_empty else np.memmap(path, np.uint8, mode="r").data, limits)


def decode_npy(body: Body, limits: Limits) -> PointCloud:
    """Decode an array. Its columns are views of the body.

    Raises:
        MalformedData: not an .npy file of points, or cut off.
        TooLarge: over the limits.
    """
    if not len(body):
        raise MalformedData("NPY: the file is empty (0 bytes)")
    head = bytes(body[:_HEAD_BYTES])
    if not head.startswith(MAGIC):
        raise MalformedData(f"NPY: the file is {kind_of(head)}, not {kind_of(MAGIC)}")
    if b"'|O'" in head:
        raise MalformedData("NPY: the array holds Python objects: save it as numbers, with dtype float32")
    try:
        array = _array(body)
    except Exception as error:  # a damaged header makes Python's tokenizer raise various exceptions
        raise MalformedData("NPY: the header is damaged, or the file is cut off") from error
    if array.dtype.names is not None and array.ndim == 1:
        named = {name: array[name] for name in array.dtype.names if array.dtype[name].kind in "fiu"}
        columns = with_axes("NPY", named)
    elif array.ndim == 2 and is_transposed(array.shape):
        raise MalformedData(f"NPY: the array has the shape {array.shape}; scans are (n, 3): transpose it")
    elif array.ndim == 2 and array.shape[1] >= 3 and array.dtype.kind in "fiu":
        names = KITTI if array.shape[1] >= 4 else KITTI[:3]
        if array.dtype.kind == "f" and len(array):  # velodyne-decoder's rows of eight have times, and others
            names = names_of(array) or names
        columns = {name: array[:, column] for column, name in enumerate(names)}
    else:
        raise MalformedData(f"NPY: {array.dtype} {array.shape} is not an (n, 3) array of numbers")
    limits.check("NPY", len(array), 8 * len(columns))
    return PointCloud(columns)


def _array(body: Body) -> NDArray[Any]:
    """The array, without a copy. NumPy reads the header alone: it takes memory for what a header says."""
    header = io.BytesIO(bytes(body[:_MAX_HEADER_BYTES]))
    version = np.lib.format.read_magic(header)
    read = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }[version]
    shape, by_column, dtype = read(header)
    if dtype.hasobject:
        raise ValueError("an array of objects")
    if any(length < 0 for length in shape):  # NumPy would take all bytes that there are
        raise ValueError("a negative length")
    flat = np.frombuffer(body, dtype, math.prod(shape), header.tell())
    return flat.reshape(shape, order="F" if by_column else "C")

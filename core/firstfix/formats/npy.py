"""Reader of NumPy's .npy files: (n, >= 3) numbers, or records with fields x, y, z. It never unpickles."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..errors import MalformedData
from ..scan.scan import is_transposed
from .file_kind import kind_of
from .point_cloud import Limits, PointCloud, with_axes
from .row_layout import KITTI, names_of

MAGIC = b"\x93NUMPY"
_HEAD_BYTES = 256


def read_npy(path: Path, limits: Limits) -> PointCloud:
    """Read a file. The file is memory-mapped, so that a wrong size in the header takes no memory.

    Raises:
        MalformedData: not an .npy file of points, or cut off.
        TooLarge: over the limits.
    """
    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES)
    if kind_of(head) != kind_of(MAGIC):
        raise MalformedData(f"NPY: the file is {kind_of(head)}, not {kind_of(MAGIC)}")
    if b"'|O'" in head:
        raise MalformedData("NPY: the array holds Python objects: save it as numbers, with dtype float32")
    try:
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    except OSError:
        raise
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

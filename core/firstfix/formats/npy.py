"""Reader of NumPy's .npy files: (n, >= 3) numbers, or records with fields x, y, z. It never unpickles."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..errors import MalformedData
from .point_cloud import Limits, PointCloud, require_xyz


def read_npy(path: Path, limits: Limits) -> PointCloud:
    """Reads a file. The file is memory-mapped, so that a wrong size in the header takes no memory.

    Raises:
        MalformedData: not an .npy file of points, or cut off.
        TooLarge: over the limits.
    """
    try:
        with path.open("rb") as file:
            if file.read(6) != b"\x93NUMPY":
                raise MalformedData("NPY: the file does not begin as an array of NumPy does")
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    except (OSError, MalformedData):
        raise
    except Exception as error:  # a damaged header makes Python's tokenizer raise various exceptions
        raise MalformedData(f"NPY: {error}") from error
    if not isinstance(array, np.ndarray):
        raise MalformedData("NPY: the file is an archive of arrays (.npz), not one array")
    if array.dtype.names is not None and array.ndim == 1:
        columns = {name: array[name] for name in array.dtype.names if array.dtype[name].kind in "fiu"}
        require_xyz("NPY", set(columns))
    elif array.ndim == 2 and array.shape[1] >= 3 and array.dtype.kind in "fiu":
        names = ("x", "y", "z", "intensity") if array.shape[1] >= 4 else ("x", "y", "z")
        columns = {name: array[:, column] for column, name in enumerate(names)}
    else:
        raise MalformedData(f"NPY: {array.dtype} {array.shape} is not an (n, 3) array of numbers")
    limits.check("NPY", len(array), 8 * len(columns))
    return PointCloud(columns)

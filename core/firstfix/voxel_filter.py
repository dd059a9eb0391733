"""Thinning a cloud to one point a cell."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def first_in_voxel(points: NDArray[np.floating], voxel_m: float) -> NDArray[np.int64]:
    """Indices, ascending, of the first point in every occupied cube of side ``voxel_m``.

    Measured points are kept as they are: a centroid would round the edges that registration holds on to.

    Args:
        points: (n, 3) finite metres; the extent over ``voxel_m`` must stay below 2**21 cells an axis.
    """
    if len(points) == 0:
        return np.empty(0, np.int64)
    cells = np.floor(np.asarray(points, np.float64) / voxel_m).astype(np.int64)
    cells -= cells.min(axis=0)
    keys = (cells[:, 2] << 42) | (cells[:, 1] << 21) | cells[:, 0]
    _, first = np.unique(keys, return_index=True)
    return np.sort(first).astype(np.int64)

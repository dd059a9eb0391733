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


def voxel_means(points: NDArray[np.floating], voxel_m: float) -> NDArray[np.float64]:
    """(m, 3) the mean of the points in every occupied cube, ordered by the cubes' z, then y, then x."""
    if len(points) == 0:
        return np.empty((0, 3))
    cells = np.floor(np.asarray(points, np.float64) / voxel_m).astype(np.int64)
    cells -= cells.min(axis=0)
    size = cells.max(axis=0) + 1
    keys = (cells[:, 2] * size[1] + cells[:, 1]) * size[0] + cells[:, 0]
    order = np.argsort(keys, kind="stable")
    start = np.flatnonzero(np.diff(keys[order], prepend=-1))
    count = np.diff(start, append=len(points))
    sums = np.add.reduceat(np.asarray(points, np.float64)[order], start, axis=0)
    return sums / count[:, None]


def even_rows(count: int, at_most: int) -> NDArray[np.int64]:
    """Rows, ascending, that take an even part of ``count``: all of them where they are few enough."""
    kept = min(count, at_most)
    return np.arange(kept) * count // max(kept, 1)

"""Slabs of points along x: work that goes voxel by voxel then needs a slab's memory, not the map's."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

MAX_POINTS = 4_000_000


def chunked_x(points: NDArray[np.floating], voxel_m: float) -> Iterator[NDArray[np.intp] | slice]:
    """Yield the rows, ascending, of (n, 3) points in each slab, in the order of x.

    A slab consists of whole voxels. It holds more than MAX_POINTS only if one layer of voxels does.
    """
    if len(points) <= MAX_POINTS:
        yield slice(None)
        return
    layer = np.floor(points[:, 0].astype(np.float64) / voxel_m).astype(np.int64)
    layer -= layer.min()
    until = np.cumsum(np.bincount(layer))  # points in each layer and all before it
    slab_of_layer = np.zeros(len(until), np.int64)
    done = number = 0
    for at, count in enumerate(until.tolist()):
        if count - done > MAX_POINTS and at:
            number, done = number + 1, int(until[at - 1])
        slab_of_layer[at] = number
    slab = slab_of_layer[layer]
    for here in np.unique(slab):
        yield np.flatnonzero(slab == here)

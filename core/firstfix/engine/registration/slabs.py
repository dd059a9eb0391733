"""Points in slabs along x: what is done voxel by voxel then takes a slab's memory, not the map's."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

MOST_POINTS = 4_000_000


def slabs(points: NDArray[np.floating], voxel_m: float) -> Iterator[NDArray[np.intp] | slice]:
    """Rows of (n, 3) points, ascending: of a slab of whole voxels each, in the order of their x. A slab has
    more than MOST_POINTS only where one layer of voxels has."""
    if len(points) <= MOST_POINTS:
        yield slice(None)
        return
    layer = np.floor(points[:, 0] / voxel_m).astype(np.int64)
    layer -= layer.min()
    until = np.cumsum(np.bincount(layer))  # points of each layer and those before
    slab_of_layer = np.zeros(len(until), np.int64)
    done = number = 0
    for at, count in enumerate(until.tolist()):
        if count - done > MOST_POINTS and at:
            number, done = number + 1, int(until[at - 1])
        slab_of_layer[at] = number
    slab = slab_of_layer[layer]
    for here in np.unique(slab):
        yield np.flatnonzero(slab == here)

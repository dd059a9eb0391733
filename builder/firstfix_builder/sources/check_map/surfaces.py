"""A map's surfaces for checks: points on a grid with their normals, of a part of a large map."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firstfix.engine.registration.surface import Surface
from firstfix.scan.reduction import voxel_means

COLUMN_M = 16.0  # a large map is looked at in some of such columns
_MAX_POINTS_READ = 3_000_000
_SEED = 34
_MAX_TABLE = 1 << 22  # cells that are counted in a table: sorting takes ten times as long


def surfaces(points: NDArray[np.float64], voxel_m: float, max_points: int) -> Surface:
    """Points (k, 3) of (n, 3) on a grid of ``voxel_m``, with normals. Of a large map some columns by chance.

    The columns stand in the plane of the two larger extents, so that it does not matter which axis is up.
    """
    flat = np.sort(np.argsort(np.ptp(points, axis=0))[1:])
    column, count = _columns(np.floor(points[:, flat] / COLUMN_M).astype(np.int64))
    order = np.random.default_rng(_SEED).permutation(len(count))
    kept = np.zeros(len(count), bool)
    kept[order[np.cumsum(count[order]) <= max(_MAX_POINTS_READ, count.max())]] = True
    thinned = voxel_means(points if kept.all() else points[kept[column]], voxel_m)
    if len(thinned) > max_points:
        share = max_points / len(thinned)
        chosen = np.zeros(len(count), bool)
        chosen[order[: max(1, round(share * len(count)))]] = True
        thinned = voxel_means(points[kept[column] & chosen[column]], voxel_m)
    return Surface.around(thinned)


def _columns(cells: NDArray[np.int64]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Number (n,) of each (n, 2) cell among those with points, by x and then y, and how many these have."""
    cells = cells - cells.min(axis=0)
    size = cells.max(axis=0) + 1
    number = cells[:, 0] * size[1] + cells[:, 1]
    if size[0] * size[1] > _MAX_TABLE:
        _, column, count = np.unique(number, return_inverse=True, return_counts=True)
        return column, count
    held = np.bincount(number, minlength=int(size[0] * size[1]))
    is_held = held > 0
    return (np.cumsum(is_held) - 1)[number], held[is_held]

"""A map's surfaces for checks: points on a grid with their normals, of a part of a large map."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firstfix.engine.registration.surface import Surface

from ...mesh.bounds import extent
from ...mesh.clean_cloud import voxel_means

COLUMN_M = 16.0  # a large map is looked at in some of such columns
_MAX_POINTS_READ = 3_000_000
_SEED = 34
MAX_TABLE = 1 << 22  # cells that are counted in a table, which is quicker than sorting them


def surfaces(points: NDArray[np.float64], voxel_m: float, max_points: int) -> Surface:
    """Points (k, 3) of (n, 3) on a grid of ``voxel_m``, with normals. Of a large map some columns by chance.

    The columns stand in the plane of the two larger extents, so that it does not matter which axis is up.

    Raises:
        BuildFailed: stray points are too far away from the others.
    """
    flat = np.sort(np.argsort(extent(points))[1:])
    column, count = numbered(np.floor(points[:, flat] / COLUMN_M).astype(np.int64))
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


def numbered(cells: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Number (n,) of each of (n, 2) cells, ascending by their coordinates, and how often (k,) each occurs."""
    low, size = cells.min(axis=0), np.ptp(cells, axis=0) + 1
    if size[0] > MAX_TABLE // size[1]:  # stray points far away: most of the table would be empty
        _, number, count = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
        return number.ravel(), count
    key = (cells[:, 0] - low[0]) * size[1] + cells[:, 1] - low[1]
    occurs = np.bincount(key)
    return (np.cumsum(occurs > 0) - 1)[key], occurs[occurs > 0]

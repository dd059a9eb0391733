"""Surfaces in NumPy: the kernels of ``firstfix.native`` are held against them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from firstfix.engine.registration.surface import Surface

NEIGHBOURS = 10
OTHER_SIDE, GRAZING = 4.0, 0.1


def neighbour_scatter(points: NDArray[np.floating]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Scatter (n, 3, 3) of every point's ten nearest, itself among them, and all that are no further.

    Returns:
        The scatter, and (n,) whether it is clear which points these are. A next one that is further by less
        than float32 can tell may or may not be among them.
    """
    exact = np.asarray(points, np.float64)
    tree = cKDTree(exact)
    reach = tree.query(exact, k=[min(NEIGHBOURS, len(exact))])[0][:, 0]
    scatter = np.empty((len(exact), 3, 3))
    nearest = tree.query_ball_point(exact, reach * (1 + 1e-12))
    clear = tree.query_ball_point(exact, reach * (1 + 1e-5), return_length=True) == list(map(len, nearest))
    for row, near in enumerate(nearest):
        off = exact[near] - exact[near].mean(axis=0)
        scatter[row] = off.T @ off
    return scatter, clear


def neighbour_scatter_by_side(
    points: NDArray[np.floating], to_viewer: NDArray[np.floating], facing: NDArray[np.floating]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """The same, where a point that faces away from another's viewer counts as OTHER_SIDE times as far."""
    exact = np.asarray(points, np.float64)
    scatter, clear = np.empty((len(exact), 3, 3)), np.empty(len(exact), np.bool_)
    for row, point in enumerate(exact):
        away = np.linalg.norm(exact - point, axis=1)
        over_limit = facing @ to_viewer[row] + GRAZING * np.linalg.norm(to_viewer[row])
        away[over_limit < 0] *= OTHER_SIDE
        reach = np.sort(away)[:NEIGHBOURS][-1]
        near = away <= reach * (1 + 1e-12)
        clear[row] = near.sum() == (away <= reach * (1 + 1e-5)).sum()
        clear[row] &= np.abs(over_limit[away < OTHER_SIDE * reach]).min() > 1e-5
        off = exact[near] - exact[near].mean(axis=0)
        scatter[row] = off.T @ off
    return scatter, clear


def thinned(surface: Surface, voxel_m: float) -> Surface:
    """Surface of the mean point of every voxel, one for each main direction of its normals."""
    axis = np.abs(surface.normals).argmax(axis=1)
    most = surface.normals[np.arange(len(surface)), axis]
    negative = (most < 0) & surface.oriented
    cell = np.floor(surface.points.astype(np.float64) / voxel_m).astype(np.int64)
    cell -= cell.min(axis=0)
    size = cell.max(axis=0) + 1
    way = 3 * (2 * negative + ~surface.oriented) + axis
    key = ((cell[:, 0] * size[1] + cell[:, 1]) * size[2] + cell[:, 2]) * 9 + way
    _, first, group, count = np.unique(key, return_index=True, return_inverse=True, return_counts=True)
    turn = np.where((most < 0) & ~surface.oriented, -1, 1)[:, None]

    def mean(values: NDArray[np.floating]) -> NDArray[np.float32]:
        sums = [np.bincount(group, weights=values[:, axis]) for axis in range(3)]
        return (np.stack(sums, axis=1) / count[:, None]).astype(np.float32)

    normals = mean(surface.normals * turn)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.float32(1e-6))
    return Surface(mean(surface.points), normals, surface.oriented[first])

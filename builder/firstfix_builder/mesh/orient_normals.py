"""Normals of a map cloud, oriented towards the scanner.

Poisson reconstruction needs to know which side of each point is free. The scanner saw the point, so the free
side is the side of the scanner. Its most likely place is the nearest one of the trajectory that other points
do not hide from the point: behind a slab or a wall, the nearest place is wrong. If no trajectory is known,
possible places of the scanner are used: above flat patches with headroom.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from firstfix.native import in_sight

STOREY_M = 2.0  # height of the slices in which places are searched, so that both sides of a slab have some
PER_STOREY = 3
SIGHT_START_VOXELS = 1.5  # the point's own surface must not hide the scanner
SIGHT_STEPS = 16  # few are enough: a slab or a wall that hides a wrong place is close to the point
EYE_M = 1.2
HEADROOM_M = 1.5
FLAT_COSINE = 0.9


def estimate_normals(points: NDArray[np.float64], radius_m: float, neighbours: int) -> NDArray[np.float64]:
    """(n, 3) unit normals of unknown sign, each from the plane through its neighbours."""
    from .open3d_core import o3d  # imported late: a provisional version does not wait for it

    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    cloud.estimate_normals(o3d.geometry.KDTreeSearchParamHybrid(radius_m, neighbours))
    return np.asarray(cloud.normals).copy()


def orient_normals(
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    places: NDArray[np.float64] | None,
    voxel_m: float,
) -> NDArray[np.float64]:
    """Orient each of (n, 3) normals towards the nearest scanner place in sight of its point.

    Args:
        places: (m, 3) where the scanner was, or None when that is unknown.
        voxel_m: grain of the occupancy that decides what is in sight.
    """
    occupied = Occupancy(points, voxel_m)
    if places is None or len(places) == 0:
        places = likely_places(points, normals, occupied)
    if len(places) == 0:  # nothing is flat: up is the best guess
        return normals * np.where(normals[:, 2:] < 0, -1.0, 1.0)
    candidates = _candidates(points, places)  # (n, k), nearest first
    sign = np.sign(np.einsum("ni,ni->n", normals, places[candidates[:, 0]] - points))
    open_points = np.arange(len(points))
    for rank in range(candidates.shape[1]):
        place = places[candidates[open_points, rank]]
        towards = np.sign(np.einsum("ni,ni->n", normals[open_points], place - points[open_points]))
        seen = occupied.in_sight(points[open_points], normals[open_points] * towards[:, None], place)
        sign[open_points[seen]] = towards[seen]
        open_points = open_points[~seen]
        if len(open_points) == 0:
            break
    sign[sign == 0] = 1.0
    oriented: NDArray[np.float64] = normals * sign[:, None]
    return oriented


def _candidates(points: NDArray[np.float64], places: NDArray[np.float64]) -> NDArray[np.int64]:
    """(n, k) indices of the nearest places of each storey, nearest first."""
    storey = np.floor((places[:, 2] - places[:, 2].min()) / STOREY_M).astype(np.int64)
    found, distances = [], []
    for level in np.unique(storey):
        members = np.flatnonzero(storey == level)
        k = min(PER_STOREY, len(members))
        distance, index = cKDTree(places[members]).query(points, k=np.arange(1, k + 1))
        found.append(members[index])
        distances.append(distance)
    all_found = np.concatenate(found, axis=1)
    order = np.argsort(np.concatenate(distances, axis=1), axis=1, kind="stable")
    return np.take_along_axis(all_found, order, axis=1)


def likely_places(
    points: NDArray[np.float64], normals: NDArray[np.float64], occupied: Occupancy
) -> NDArray[np.float64]:
    """(m, 3) places at eye height above flat patches, one a cubic metre, with free space overhead.

    A flat sheet with a floor below and nothing but sky above is taken for a ceiling seen from inside,
    not for a roof: nobody stood on it.
    """
    flat = np.flatnonzero(np.abs(normals[:, 2]) > FLAT_COSINE)
    _, first = np.unique(np.floor(points[flat]), axis=0, return_index=True)
    number = flat[np.sort(first)]
    free = np.ones(len(number), bool)
    for height in np.arange(SIGHT_START_VOXELS * occupied.voxel_m, HEADROOM_M, occupied.voxel_m):
        free &= ~occupied.at(points[number] + [0.0, 0.0, height])
    number = number[free]
    columns, column = np.unique(np.floor(points[:, :2]), axis=0, return_inverse=True)
    top = np.full(len(columns), -np.inf)
    np.maximum.at(top, column, points[:, 2])
    bottom = np.full(len(columns), np.inf)
    foot, own = points[number], column[number]
    np.minimum.at(bottom, own, foot[:, 2])
    ceiling = (foot[:, 2] > bottom[own] + HEADROOM_M) & (top[own] < foot[:, 2] + HEADROOM_M)
    places: NDArray[np.float64] = foot[~ceiling] + [0.0, 0.0, EYE_M]
    return places


class Occupancy:
    """Voxels of a cloud that hold a point. Their corners are at multiples of the voxel's edge."""

    def __init__(self, points: NDArray[np.float64], voxel_m: float) -> None:
        self.voxel_m = voxel_m
        cell = np.floor(points / voxel_m).astype(np.int64)
        self._low = cell.min(axis=0)
        self._size = cell.max(axis=0) - self._low + 1
        self._grid = np.zeros(int(np.prod(self._size)), bool)
        self._grid[self._flat(cell - self._low)] = True

    def at(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """(n,) whether the voxel of a point is occupied; outside the cloud none is."""
        cell = np.floor(points / self.voxel_m).astype(np.int64) - self._low
        inside = ((cell >= 0) & (cell < self._size)).all(axis=1)
        hit = np.zeros(len(points), bool)
        hit[inside] = self._grid[self._flat(cell[inside])]
        return hit

    def in_sight(
        self, points: NDArray[np.float64], outwards: NDArray[np.float64], places: NDArray[np.float64]
    ) -> NDArray[np.bool_]:
        """(n,) whether nothing near the point hides it from its place."""
        seen = in_sight(
            self._grid.reshape(self._size).view(np.uint8),
            self._low,
            self.voxel_m,
            points,
            outwards,
            places,
            SIGHT_START_VOXELS,
            SIGHT_STEPS,
        )
        return seen.view(np.bool_)

    def _flat(self, cell: NDArray[np.int64]) -> NDArray[np.int64]:
        flat: NDArray[np.int64] = (cell[:, 0] * self._size[1] + cell[:, 1]) * self._size[2] + cell[:, 2]
        return flat

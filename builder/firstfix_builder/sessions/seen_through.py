"""Finds points of an earlier session that a later one saw through: the thing there has left."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ..simulation.simulate import Simulator

FAR_FROM_SURFACE_M = 0.3  # points nearer to the later session's surface are still there
SIGHT_M = 15.0
BEHIND_M = 0.3  # the surface that the ray meets is at least this far behind the point
WITNESSES = 6  # nearest sensor positions of the later run, from which a point is looked at
MIN_WITNESSES = 2  # of these that must have seen through it
PLACE_STEP_M = 0.5
_AT_ONCE = 200_000


def seen_through(
    points: NDArray[np.float64], simulator: Simulator, trajectory: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Returns for each of (n, 3) earlier points whether the later session saw through it.

    Only the sensor positions of the later run count: nothing is known about the view from other places.

    Args:
        simulator: mesh of the later session, in whose frame all arguments are.
        trajectory: (m, 4, 4) of the later session's sensor.
    """
    gone = np.zeros(len(points), np.bool_)
    places = _thinned(trajectory[:, :3, 3])
    tree = cKDTree(places)
    for start in range(0, len(points), _AT_ONCE):
        part = points[start : start + _AT_ONCE]
        rows = np.flatnonzero(tree.query(part, distance_upper_bound=SIGHT_M)[0] < SIGHT_M)
        rows = rows[simulator.distance(part[rows]) > FAR_FROM_SURFACE_M] if len(rows) else rows
        if len(rows):
            gone[start + rows] = _witnesses(part[rows], simulator, places, tree) >= MIN_WITNESSES
    return gone


def _witnesses(
    points: NDArray[np.float64], simulator: Simulator, places: NDArray[np.float64], tree: cKDTree
) -> NDArray[np.int64]:
    """(n,) number of places from which a surface was seen behind each point."""
    away_m, nearest = tree.query(points, k=list(range(1, min(WITNESSES, len(places)) + 1)))
    count = np.zeros(len(points), np.int64)
    for column in range(nearest.shape[1]):
        within = np.flatnonzero((away_m[:, column] < SIGHT_M) & (away_m[:, column] > 0))
        if len(within):
            origins, range_m = places[nearest[within, column]], away_m[within, column]
            hit_m = simulator.cast(origins, (points[within] - origins) / range_m[:, None])
            count[within] += np.isfinite(hit_m) & (hit_m > range_m + BEHIND_M)
    return count


def _thinned(positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """One position for each half metre: a robot that stood still counts once."""
    _, first = np.unique(np.floor(positions / PLACE_STEP_M), axis=0, return_index=True)
    return positions[np.sort(first)]

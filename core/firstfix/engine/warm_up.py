"""Scans that a version's own map gives, to ask it before a robot does.

The first query of a process sets up libraries and memory, and the first one of a version maps in the pages of
its files that every query reads. Such a scan has the map's points as they would be seen from a template: it
takes the way of a robot's scan through the whole engine.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ..bit_exact.sample import rows_by_chance
from ..scan.scan import Scan
from .index import MapIndex
from .verification.point_tiles import PointTiles

VIEWPOINTS = 3
_NEAR_M, _FAR_M = 9.0, 40.0  # up to which the map's fine and its coarse points are taken
_DIRECTION_DEG = 1.0  # of which only the nearest point is seen
_MAX_ROWS = 1000  # of directions from the lowest to the highest


def own_scans(index: MapIndex, count: int = VIEWPOINTS) -> Iterator[Scan]:
    """Yield scans at ``count`` templates (``rows_by_chance``) of the map, or at all of a smaller map."""
    position_m = index.cascade.templates.position_m
    for row in rows_by_chance(len(position_m), count):
        yield seen_from(index, np.asarray(position_m[row], np.float64))


def seen_from(index: MapIndex, position_m: NDArray[np.float64]) -> Scan:
    """The map's points that a level sensor would see.

    Args:
        index: of the map.
        position_m: (3,) of the sensor, in the index's frame.
    """
    near, far = _around(index.view.near, position_m, _NEAR_M), _around(index.view.far, position_m, _FAR_M)
    beyond = far[np.linalg.norm(far, axis=1) > _NEAR_M]
    points = np.concatenate([near, beyond])
    distance_m = np.linalg.norm(points, axis=1)
    azimuth = np.arctan2(points[:, 1], points[:, 0])
    elevation = np.arcsin(points[:, 2] / np.maximum(distance_m, 1e-6))
    column, row = (
        np.floor(np.degrees(angle) / _DIRECTION_DEG).astype(np.int64) for angle in (azimuth, elevation)
    )
    direction = column * _MAX_ROWS + row
    nearest_first = np.argsort(distance_m, kind="stable")
    _, seen = np.unique(direction[nearest_first], return_index=True)
    return Scan.from_points(points[nearest_first[seen]])


def _around(tiles: PointTiles, centre: NDArray[np.float64], reach_m: float) -> NDArray[np.float64]:
    """(n, 3) points within reach of a centre, relative to it."""
    points = tiles.around(centre, reach_m).astype(np.float64) - centre
    near: NDArray[np.float64] = points[np.linalg.norm(points, axis=1) <= reach_m]
    return near

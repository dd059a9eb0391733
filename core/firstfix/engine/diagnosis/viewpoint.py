"""One viewpoint: whether a scan was taken from its own origin.

Each beam of a LiDAR has a direction of its own. So from where a scan was taken, its points lie in more
directions than from anywhere else: the ground around the sensor alone collapses to few directions elsewhere.
Directions are those of the range view. On 129 right scans of real places, the best viewpoint beyond 1.5 m has
at most 1.17 times as many as the origin (docs/experiments.md).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from ...native import nearest_by_direction
from ...scan.reduction import at_most
from ...transform import Matrix

POINTS = 2000
GLANCE_M = 4.0  # from the origin, towards the middle of the points
SUSPECT = 1.06  # directions at a glance, against those from the origin
ELSEWHERE = 1.3
ELSEWHERE_AT_MAP_ORIGIN = 1.2  # where the pose is the map's own origin, which is rarely a robot's place
AWAY_M = 1.5  # robots carry LiDARs so far from the frame of their scans
SAME_M, SAME_DEG = 0.15, 1.5  # from the map's origin
_STEPS_M = (8.0, 4.0, 2.0, 1.0, 0.5)
_ROUNDS = 6  # with one step, at most
_AROUND = np.array([(x, y, 0.0) for x, y in product((-1, 0, 1), repeat=2) if x or y])
_RISE_M = 1.0  # the search does not leave the height of the origin further: from above, all is in view

MAP_POINTS = 200_000  # in range: fewer may be a terrestrial scan, which its scanner has thinned evenly
MAP_CELL_M = 0.25
MAP_NEAR, MAP_FAR = (0.1, 0.35), (0.75, 1.0)  # shares of the points, by their ranges
MAP_EVEN = 2.0  # points in a cell near the sensor over those in a cell far from it; raw scans have 3 to 22


@dataclass(frozen=True)
class Viewpoint:
    """A place from which a scan may have been taken.

    Attributes:
        position_m: (3,) in the scan's frame.
        spread_ratio: number of directions in which the points lie, seen from it, over those from the origin.
    """

    position_m: NDArray[np.float64]
    spread_ratio: float


def is_suspect(part: NDArray[np.float32]) -> bool:
    """Returns whether some hundred (n, 3) points lie in more directions seen from elsewhere.

    It is a glance, for every scan.
    """
    enough = SUSPECT * _directions(part, np.zeros(3, np.float32))
    middle = _middle(part)
    if _directions(part, middle) > enough:
        return True
    level_m = max(float(np.hypot(middle[0], middle[1])), 1e-3)
    return _directions(part, middle * (GLANCE_M / level_m, GLANCE_M / level_m, 0)) > enough


def best_viewpoint(points: NDArray[np.float32]) -> Viewpoint:
    """The place from which (n, 3) points lie in the most directions: by a search in falling steps."""
    part = at_most(points, POINTS)
    own = _directions(part, np.zeros(3))
    starts = [np.zeros(3), _middle(part) * [1, 1, 0]]
    most, best = max((_directions(part, at), tuple(at)) for at in starts)
    at = np.array(best)
    for step_m in _STEPS_M:
        for _ in range(_ROUNDS):
            tried = [at + step_m * offset for offset in _AROUND]
            tried += [at + [0, 0, rise] for rise in (-step_m, step_m) if abs(at[2] + rise) <= _RISE_M]
            counts = [_directions(part, one) for one in tried]
            if max(counts) <= most:
                break
            most, at = max(counts), tried[int(np.argmax(counts))]
    return Viewpoint(at, most / max(own, 1))


def is_elsewhere(viewpoint: Viewpoint, T_map_sensor: Matrix | None) -> bool:
    """Returns whether the viewpoint shows that a scan was not taken from its origin.

    Args:
        T_map_sensor: (4, 4) pose that is to be answered, or None.
    """
    at_origin = T_map_sensor is not None and is_map_origin(T_map_sensor)
    needed = ELSEWHERE_AT_MAP_ORIGIN if at_origin else ELSEWHERE
    away_m = float(np.linalg.norm(viewpoint.position_m))
    return away_m > AWAY_M and viewpoint.spread_ratio > needed


def is_map_origin(T_map_sensor: Matrix) -> bool:
    """Returns whether a (4, 4) pose is that of the map's own frame."""
    if max(map(abs, T_map_sensor[:3, 3].tolist())) > SAME_M:
        return False
    return bool((np.trace(T_map_sensor[:3, :3]) - 1) / 2 > math.cos(math.radians(SAME_DEG)))


def is_even(points: NDArray[np.float32]) -> bool:
    """Returns whether (n, 3) points are as dense far from the origin as near it: those of a map."""
    if len(points) < MAP_POINTS:
        return False
    range_m = np.linalg.norm(points, axis=1)
    limits_m = np.quantile(range_m, [*MAP_NEAR, *MAP_FAR])
    near, far = (
        _points_a_cell(points[(range_m >= least) & (range_m <= most)])
        for least, most in (limits_m[:2], limits_m[2:])
    )
    return near < MAP_EVEN * far


def _points_a_cell(points: NDArray[np.float32]) -> float:
    """Mean number of points in the occupied cells."""
    cells = np.floor(points / MAP_CELL_M).astype(np.int64) + 1024
    return len(points) / len(np.unique((cells[:, 0] << 22) | (cells[:, 1] << 11) | cells[:, 2]))


def _middle(points: NDArray[np.float32]) -> NDArray[np.float32]:
    """Median (3,) of (n, 3) points on each axis: the ground near the sensor has most of a scan's points."""
    half = len(points) // 2
    return np.partition(points, half, axis=0)[half]


def _directions(points: NDArray[np.float32], at: NDArray[np.floating]) -> int:
    """Number of directions of the range view in which the points lie, seen from a place."""
    seen = np.subtract(points, at, dtype=np.float32)
    return int(np.count_nonzero(np.isfinite(nearest_by_direction(seen))))

"""One viewpoint: whether a scan was taken from its own origin.

Each beam of a LiDAR has a direction of its own. So from where a scan was taken, its points lie in many
directions, and evenly: the ground around the sensor alone collapses to few directions elsewhere.
Directions are those of the range view. A scan of a part of the turn lies in few directions from its own
origin too, and a step into its sector spreads them all around. So their number is weighed by the share of the
turn that the scan fills, and by how evenly its points lie in them (section 7.3 of docs/method.md).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from ...native import is_spread_elsewhere, nearest_by_direction
from ...scan.reduction import COLUMNS, ROWS, at_most, cells_of
from ...transform import Matrix

POINTS = 2000
PROBE_M = 4.0  # from the origin, towards the middle of the points
SUSPECT = 1.06  # directions from a probed place, against those from the origin
MORE = 1.2  # directions from the best viewpoint, against those from the origin: with fewer, none is better
ELSEWHERE = 1.1  # evidence, where no pose is lost by it, or that of the map's own origin
ELSEWHERE_DESPITE_POSE = 2.0  # of right scans without a pose it is 1.6 at most
AWAY_M = 1.5  # robots carry LiDARs so far from the frame of their scans
SAME_M, SAME_DEG = 0.15, 1.5  # from the map's origin
_STEPS_M = (8.0, 4.0, 2.0, 1.0, 0.5)
_ROUNDS = 6  # with one step, at most
_AROUND = np.array([(x, y, 0.0) for x, y in product((-1, 0, 1), repeat=2) if x or y])
_RISE_M = 1.0  # the search does not leave the height of the origin further: from above, all is in view

WEIGHED = 20_000  # points
_SHARE_CELLS = 3  # of the range view: columns of 6 degrees
_EVEN_CELLS = (2, 3)  # of the range view: directions of 4 degrees, and of 6 for fewer points
_POINTS_A_CELL = 8  # with fewer, chance decides on how even they are

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
        filled_share: share (0..1) of the turn about the origin in which points lie.
        evenness_ratio: how evenly the points lie in these directions, seen from it, over how evenly from the
            origin; 1: not known.
    """

    position_m: NDArray[np.float64]
    spread_ratio: float
    filled_share: float
    evenness_ratio: float

    @property
    def evidence(self) -> float:
        """How much better it explains the points than their origin does.

        A window of a share s of the turn can be spread over 1/s times its directions by a step into it, and
        no further. They are then filled less evenly, while a wrong frame's origin fills its own less evenly.
        Only the latter counts: near the true place, but not at it, nothing is even.
        """
        return self.spread_ratio * self.filled_share * max(self.evenness_ratio, 1.0)


def is_suspect(part: NDArray[np.float32]) -> bool:
    """Whether some hundred (n, 3) points lie in more directions seen from elsewhere.

    It is a quick probe, for every scan.
    """
    return is_spread_elsewhere(part, SUSPECT, PROBE_M)


def best_viewpoint(points: NDArray[np.float32]) -> Viewpoint:
    """The place from which (n, 3) points lie in the most directions: by a search in falling steps."""
    part = at_most(points, POINTS)
    own = _directions(part, np.zeros(3))
    starts = [np.zeros(3), np.append(_middle(part)[:2], 0.0)]
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
    weighed = at_most(points, WEIGHED)
    own_view, view = _density(weighed, np.zeros(3)), _density(weighed, at)
    return Viewpoint(at, most / max(own, 1), _filled_share(own_view), _evenness_ratio(own_view, view))


def is_elsewhere(viewpoint: Viewpoint, T_map_sensor: Matrix | None) -> bool:
    """Whether the viewpoint shows that a scan was not taken from its origin.

    A pose has evidence of its own: only more of it turns the pose away. The pose of the map's own origin has
    none, because a scan in the map's frame lies there best.

    Args:
        T_map_sensor: (4, 4) pose that is to be answered, or None.
    """
    away_m = float(np.linalg.norm(viewpoint.position_m))
    if away_m <= AWAY_M or viewpoint.spread_ratio <= MORE:
        return False
    is_free = T_map_sensor is None or is_map_origin(T_map_sensor)
    return viewpoint.evidence > (ELSEWHERE if is_free else ELSEWHERE_DESPITE_POSE)


def is_map_origin(T_map_sensor: Matrix) -> bool:
    """Whether a (4, 4) pose is that of the map's own frame."""
    if max(map(abs, T_map_sensor[:3, 3].tolist())) > SAME_M:
        return False
    return bool((np.trace(T_map_sensor[:3, :3]) - 1) / 2 > math.cos(math.radians(SAME_DEG)))


def is_even(points: NDArray[np.float32]) -> bool:
    """Whether (n, 3) points are as dense far from the origin as near it: those of a map."""
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
    half, parted = len(points) // 2, points.copy()
    parted.partition(half, axis=0)
    middle: NDArray[np.float32] = parted[half]
    return middle


def _directions(points: NDArray[np.float32], at: NDArray[np.floating]) -> int:
    """Number of directions of the range view in which the points lie, seen from a place."""
    seen = np.subtract(points, at, dtype=np.float32)
    return int(np.isfinite(nearest_by_direction(seen)).sum())


def _density(points: NDArray[np.float32], at: NDArray[np.floating]) -> NDArray[np.int64]:
    """Number (ROWS, COLUMNS) of the points in each direction of the range view, seen from a place."""
    cells = cells_of(np.subtract(points, at, dtype=np.float32))
    return np.bincount(cells, minlength=ROWS * COLUMNS).reshape(ROWS, COLUMNS)


def _filled_share(view: NDArray[np.int64]) -> float:
    """Share of the turn in which points lie."""
    return float(np.mean(view.sum(axis=0).reshape(-1, _SHARE_CELLS).any(axis=1)))


def _evenness_ratio(own_view: NDArray[np.int64], view: NDArray[np.int64]) -> float:
    """Evenness of a view over that of the own one, in the finest directions that have enough points."""
    points = int(own_view.sum())
    for size in _EVEN_CELLS:
        own, other = (
            one.reshape(ROWS // size, size, COLUMNS // size, size).sum(axis=(1, 3))
            for one in (own_view, view)
        )
        if points >= _POINTS_A_CELL * max(np.count_nonzero(own), np.count_nonzero(other)):
            return _evenness(other) / _evenness(own)
    return 1.0


def _evenness(view: NDArray[np.int64]) -> float:
    """Evenness (0..1) of points in the directions that they fill.

    With p the chance that two points share a direction, 1 / p even directions would give the same.
    """
    points = float(view.sum())
    shared = float((view * (view - 1)).sum()) / (points * (points - 1))
    return 1 / (shared * np.count_nonzero(view))

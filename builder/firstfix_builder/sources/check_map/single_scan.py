"""A single scan in place of a map: all points are seen from one place, and as a sensor sees them.

From where a scan was taken, nothing hides anything, and near and far directions have about as many points: a
beam each. Of a map, walls stand behind walls; and where it is one open hall, its far directions have many
more points, since a map has them evenly on its surfaces.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from firstfix.bit_exact.sample import rows_by_chance
from firstfix.engine.diagnosis.viewpoint import best_viewpoint
from firstfix.findings.finding import Finding
from firstfix.findings.map_kinds import MAP_SINGLE_SCAN

from .told_places import marked

# Of scans of six sensors at most 0.12 and 0.44; of maps, 0.17 and more or 0.49 and more.
MOST_HIDDEN, MOST_GROWTH = 0.15, 0.45
MOST_POSES = 2  # a map of more was not taken from one place
DIRECTION_DEG = 1.0
# Of thin maps a direction has one point, near or far. In directions twice as wide the number grows with the
# range: of maps in voxels of 0.5 m by 0.73 and more, of scans by 0.46 at most.
WIDE_DEG, MOST_WIDE_GROWTH = 2.0, 0.6
BEHIND = 1.3  # times as far: what is behind something else, and no slanted surface
_SAMPLED_POINTS, _MIN_DIRECTIONS = 60_000, 200
_NEAREST_M = 0.3
_LEVEL = 0.05  # of the lowest points near the densest place
_OVER_M, _SQUARE_M = 1.0, 1.0


def check_single_scan(
    points: NDArray[np.float64], poses: NDArray[np.float64] | None, origin: NDArray[np.float64]
) -> Finding | None:
    """Finding of (n, 3) points that are one scan.

    Args:
        poses: (m, 4, 4) T_map_sensor, or None.
        origin: (3,) what brings coordinates of the map to those of the file.
    """
    if poses is not None and len(poses) > MOST_POSES:
        return None
    sample = points[rows_by_chance(len(points), _SAMPLED_POINTS)]
    for at in _viewpoints(sample, poses, origin):
        hidden, growth = _as_seen(sample - at, DIRECTION_DEG)
        is_seen = hidden < MOST_HIDDEN and growth < MOST_GROWTH
        if is_seen and _as_seen(sample - at, WIDE_DEG)[1] < MOST_WIDE_GROWTH:
            place = marked(at[None], origin)
            x, y, z = place[0]
            numbers = {"hidden_share": hidden, "growth": growth, "points": len(points)}
            return MAP_SINGLE_SCAN.found(numbers, viewpoint=f"({x:.1f}, {y:.1f}, {z:.1f})").at(place)
    return None


def _viewpoints(
    sample: NDArray[np.float64], poses: NDArray[np.float64] | None, origin: NDArray[np.float64]
) -> Iterator[NDArray[np.float64]]:
    """Places (3,) from which the points may have been seen: the file's origin, poses, and by a search."""
    yield -origin
    if poses is not None:
        yield from poses[:, :3, 3]
    start = _densest(sample)
    yield best_viewpoint((sample - start).astype(np.float32)).position_m + start


def _densest(sample: NDArray[np.float64]) -> NDArray[np.float64]:
    """Place (3,) over the ground at which the points are densest."""
    square, count = np.unique(np.floor(sample[:, :2] / _SQUARE_M), axis=0, return_counts=True)
    middle = (square[np.argmax(count)] + 0.5) * _SQUARE_M
    near = np.abs(sample[:, :2] - middle).max(axis=1) < _SQUARE_M
    return np.array([*middle, np.quantile(sample[near, 2], _LEVEL) + _OVER_M])


def _as_seen(seen: NDArray[np.float64], direction_deg: float) -> tuple[float, float]:
    """How (n, 3) points look from the origin, in directions so wide.

    Returns:
        share of the directions in which something is behind something else, and the power of the range with
        which the number of points in a direction grows: 0 of a scan, 2 of even points on surfaces.
    """
    range_m = np.linalg.norm(seen, axis=1)
    far = range_m > _NEAREST_M
    seen, range_m = seen[far], range_m[far]
    turn = np.floor(np.degrees(np.arctan2(seen[:, 1], seen[:, 0])) / direction_deg)
    rise = np.floor(np.degrees(np.arcsin(seen[:, 2] / range_m)) / direction_deg)
    direction = turn * 1000 + rise
    order = np.lexsort((range_m, direction))
    direction, range_m = direction[order], range_m[order]
    is_first = np.ones(len(order), bool)
    is_first[1:] = direction[1:] != direction[:-1]
    first = np.flatnonzero(is_first)
    if len(first) < _MIN_DIRECTIONS:
        return 1.0, 2.0
    count = np.diff(np.append(first, len(order)))
    step = np.ones(len(order))
    step[1:] = np.where(is_first[1:], 1.0, range_m[1:] / range_m[:-1])
    several = count > 1
    hidden = float((np.maximum.reduceat(step, first)[several] > BEHIND).mean()) if several.any() else 1.0
    middle_m = np.log(range_m[first + count // 2])
    return hidden, float(np.polyfit(middle_m, np.log(count), 1)[0])

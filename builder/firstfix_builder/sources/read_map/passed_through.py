"""Points that scans of the mapping run saw through: trails of what moved (docs/method.md section 1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firstfix.transform import Matrix, inverse, transform_points

CELL_DEG = 1.0  # of directions
FILLED = 7  # of a cell and its eight neighbours: enough returns to say that nothing stands there
SIGHT_M = 40.0
NEAR_M = 1.0
BEHIND_M, BEHIND_SHARE = 0.3, 0.03  # of the range
PASSES_A_HIT = 3


@dataclass
class Sightings:
    """How often the points of a map were seen through, and how often they were met.

    Attributes:
        points: (n, 3) metres, map frame.
        passed, met: (n,) number of scans.
    """

    points: NDArray[np.float64]
    passed: NDArray[np.int32]
    met: NDArray[np.int32]

    @classmethod
    def of(cls, points: NDArray[np.float64]) -> Sightings:
        """No sighting yet."""
        return cls(points, np.zeros(len(points), np.int32), np.zeros(len(points), np.int32))

    def look(self, scan: NDArray[np.floating], T_map_sensor: Matrix) -> None:
        """Count what a scan of (k, 3) points in the sensor frame says of each point within its sight.

        A point was seen through if every return in and around its direction lies behind it. A ray along a
        floor has nearer returns of the floor beside it, and one past a pole has those of the pole.
        """
        nearest, around = _nearest_returns(scan)
        near = (np.abs(self.points - T_map_sensor[:3, 3]) < SIGHT_M).all(axis=1)
        rows = np.flatnonzero(near)
        range_m, cell = _directions(transform_points(inverse(T_map_sensor), self.points[rows]))
        in_sight = (range_m > NEAR_M) & (range_m < SIGHT_M)
        rows, range_m, cell = rows[in_sight], range_m[in_sight], cell[in_sight]
        margin_m = BEHIND_M + BEHIND_SHARE * range_m
        self.passed[rows[around[cell] > range_m + margin_m]] += 1
        self.met[rows[np.abs(nearest[cell] - range_m) <= margin_m]] += 1

    def left(self, passes: int) -> NDArray[np.bool_]:
        """(n,) which points had left when at least so many scans looked there."""
        return (self.passed >= passes) & (self.passed >= PASSES_A_HIT * self.met)


_COLUMNS, _ROWS = round(360 / CELL_DEG), round(180 / CELL_DEG)


def _directions(points: NDArray[np.floating]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """(n,) range and (n,) cell of the direction of (n, 3) points."""
    at = np.asarray(points, np.float64)
    range_m = np.linalg.norm(at, axis=1)
    azimuth = np.degrees(np.arctan2(at[:, 1], at[:, 0])) + 180
    elevation = np.degrees(np.arcsin(np.clip(at[:, 2] / np.maximum(range_m, 1e-9), -1, 1))) + 90
    column = np.floor(azimuth / CELL_DEG).astype(np.int64) % _COLUMNS
    row = np.minimum(np.floor(elevation / CELL_DEG).astype(np.int64), _ROWS - 1)
    return range_m, column * _ROWS + row


def _nearest_returns(scan: NDArray[np.floating]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """By cell the nearest return in it, inf without one, and around it, -inf if too few cells have one."""
    range_m, cell = _directions(scan[np.isfinite(scan).all(axis=1)])
    flat = np.full(_COLUMNS * _ROWS, np.inf)
    real = range_m > NEAR_M
    np.minimum.at(flat, cell[real], range_m[real])
    image = np.pad(flat.reshape(_COLUMNS, _ROWS), ((0, 0), (1, 1)), constant_values=np.inf)
    image = np.concatenate([image[-1:], image, image[:1]])
    parts = np.stack([image[a : a + _COLUMNS, b : b + _ROWS] for a in range(3) for b in range(3)])
    filled = np.isfinite(parts).sum(axis=0) >= FILLED
    return flat, np.where(filled, parts.min(axis=0), -np.inf).ravel()

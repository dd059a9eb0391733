"""Places of a map, spread over it: squares that have points, and the ground's height around each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from firstfix.bit_exact.sample import rows_by_chance

from .columns import Columns

SQUARE_M = 2.0
AROUND_M = 4.0  # the lowest points so near are at the ground: beside a wall, under a ceiling
BELOW_M, ABOVE_M = 0.6, 3.0
_SAMPLED_POINTS, _SAMPLED_PLACES, _MIN_POINTS = 100_000, 400, 6
_STRAY_SHARE = 0.03  # of a square's points lie below the ground: reflections


@dataclass(frozen=True)
class MapPlaces:
    """Columns of a map at places by chance.

    Attributes:
        at: (k, 3) their middles, at the height of the lowest points around.
        columns: of each.
    """

    at: NDArray[np.float64]
    columns: Columns

    @classmethod
    def of(cls, points: NDArray[np.float64]) -> MapPlaces:
        """Places of a map with (n, 3) points."""
        sample = points[rows_by_chance(len(points), _SAMPLED_POINTS)]
        squares = np.floor(sample[:, :2] / SQUARE_M).astype(np.int64)
        square, of_square, count = np.unique(squares, axis=0, return_inverse=True, return_counts=True)
        heights = sample[np.lexsort((sample[:, 2], of_square.ravel())), 2]
        low_m = heights[np.cumsum(count) - count + (_STRAY_SHARE * count).astype(np.int64)]
        full = count >= _MIN_POINTS
        middles, low_m = (square[full] + 0.5) * SQUARE_M, low_m[full]
        chosen = rows_by_chance(len(middles), _SAMPLED_PLACES)
        if not len(chosen):
            return cls(np.empty((0, 3)), Columns.at(points[:0], np.empty((0, 3)), -BELOW_M, ABOVE_M))
        near = cKDTree(middles).query_ball_point(middles[chosen], AROUND_M)
        at = np.column_stack([middles[chosen], [low_m[rows].min() for rows in near]])
        return cls(at, Columns.at(points, at, -BELOW_M, ABOVE_M))

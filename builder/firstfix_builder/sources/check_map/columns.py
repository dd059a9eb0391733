"""Level layers of a map in columns: floors, ceilings and the like, by how much of a column they fill.

A level surface fills the column from side to side within a decimetre or two of height, a wall or a post does
not. No normals are needed, so thin and noisy maps have layers, too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

CELL_M = 0.4
RADIUS_M = 1.0
BIN_M = 0.05
FILLED = 0.4  # of the column's cells: a floor beside a wall, or with holes
NEARLY_MOST = 0.8  # of the best layer's share: people and the robot itself are less
_SIDE = 1 << 21  # cells on a side: the columns of a map on this planet have numbers of their own


def _disc() -> NDArray[np.int64]:
    reach = int(RADIUS_M / CELL_M)
    x, y = np.mgrid[-reach : reach + 1, -reach : reach + 1].reshape(2, -1)
    offsets: NDArray[np.int64] = np.column_stack([x, y])[np.hypot(x, y) * CELL_M <= RADIUS_M]
    return offsets


_OFFSETS = _disc()  # (c, 2)


@dataclass(frozen=True)
class Layers:
    """Level layers of columns, each the best within some heights.

    Attributes:
        column: (n,) number of the column, ascending.
        height_m: (n,) over the height that was asked for, ascending in each column.
        filled: (n,) share (0..1) of the column's cells.
    """

    column: NDArray[np.intp]
    height_m: NDArray[np.float64]
    filled: NDArray[np.float64]

    def where(self, kept: NDArray[np.bool_]) -> Layers:
        """Some of the layers."""
        return Layers(self.column[kept], self.height_m[kept], self.filled[kept])

    def nearly_most(self, count: int) -> Layers:
        """Those that fill nearly as much as the best of their column; ``count`` columns there are."""
        best = np.zeros(count)
        np.maximum.at(best, self.column, self.filled)
        return self.where(self.filled >= NEARLY_MOST * best[self.column])

    def highest(self, count: int) -> NDArray[np.float64]:
        """Height (count,) of the highest layer of each column; NaN without one."""
        height_m = np.full(count, np.nan)
        height_m[self.column] = self.height_m  # the last of a column stays
        return height_m


@dataclass(frozen=True)
class Columns:
    """Cells of columns that have points, by their height over (or below) a place each.

    Attributes:
        low_m: height of the lowest bin's lower end.
        met: (k, b, c) whether a cell has points in a bin of BIN_M.
        sum_m, count: (k, b) sum of the heights of the points, and their number.
    """

    low_m: float
    met: NDArray[np.bool_]
    sum_m: NDArray[np.float64]
    count: NDArray[np.int64]

    @classmethod
    def at(
        cls, points: NDArray[np.float64], places: NDArray[np.float64], low_m: float, high_m: float
    ) -> Columns:
        """Columns of (n, 3) points around (k, 3) places, from low_m to high_m over each."""
        columns = np.floor(places[:, :2] / CELL_M).astype(np.int64)[:, None] + _OFFSETS  # (k, c, 2)
        asked = _numbers(columns).ravel()
        numbers = _numbers(np.floor(points[:, :2] / CELL_M).astype(np.int64))
        wanted = np.unique(asked)
        near = wanted[np.minimum(np.searchsorted(wanted, numbers), len(wanted) - 1)] == numbers
        rows = np.flatnonzero(near)
        rows = rows[np.argsort(numbers[rows], kind="stable")]
        numbers = numbers[rows]
        first = np.searchsorted(numbers, asked, "left")
        many = np.searchsorted(numbers, asked, "right") - first
        row = rows[np.repeat(first - (np.cumsum(many) - many), many) + np.arange(many.sum())]
        column, cell = np.divmod(np.repeat(np.arange(len(asked)), many), len(_OFFSETS))
        over_m = points[row, 2] - places[column, 2]
        within = (over_m >= low_m) & (over_m < high_m)
        column, cell, over_m = column[within], cell[within], over_m[within]
        bins = round((high_m - low_m) / BIN_M) + 1
        place = column * bins + np.floor((over_m - low_m) / BIN_M).astype(np.int64)
        met = np.zeros((len(places) * bins, len(_OFFSETS)), bool)
        met[place, cell] = True
        size = len(places) * bins
        return cls(
            low_m,
            met.reshape(len(places), bins, len(_OFFSETS)),
            np.bincount(place, weights=over_m, minlength=size).astype(np.float64).reshape(-1, bins),
            np.bincount(place, minlength=size).reshape(-1, bins),
        )

    def __len__(self) -> int:
        return len(self.met)

    def filled(self, bins: int) -> NDArray[np.float64]:
        """Share (k, b) of each column's cells that have points in so many bins from each on."""
        return _together(self.met, bins, np.logical_or).mean(axis=2)

    def layers(self, bins: int, apart: int, least: float = FILLED) -> Layers:
        """Layers as thick as so many bins, each filling more than the others within ``apart`` bins."""
        filled, count = self.filled(bins), _together(self.count, bins, np.add)
        rank = filled + count / (count.max() + 1) / _OFFSETS.size  # of equally filled ones the densest
        best = rank.copy()
        for step in range(1, apart + 1):
            best[:, step:] = np.maximum(best[:, step:], rank[:, :-step])
            best[:, :-step] = np.maximum(best[:, :-step], rank[:, step:])
        column, slab = np.nonzero((filled >= least) & (rank >= best))
        height_m = _together(self.sum_m, bins, np.add)[column, slab] / count[column, slab]
        return Layers(column, height_m, filled[column, slab])


def _together(values: np.ndarray, bins: int, join: np.ufunc) -> np.ndarray:
    """Values of each bin joined with those of the ``bins - 1`` above it."""
    joined = values.copy()
    for step in range(1, bins):
        joined[:, :-step] = join(joined[:, :-step], values[:, step:])
    return joined


def _numbers(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """One number for each (..., 2) cell."""
    return (cells[..., 0] + _SIDE // 2) * _SIDE + cells[..., 1] + _SIDE // 2

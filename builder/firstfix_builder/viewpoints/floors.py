"""Every surface of a map that something could stand on: a vertical line through each column of a grid.

A column is a cell of the ground plane. What one finds in it from above is a stack of surfaces; a floor
is one with headroom over it that is not too steep. Steepness is asked twice, and one yes is enough: the
triangle itself (a stair's tread is level, though the stairs are steep) and the plane through the
neighbours (a reconstructed floor is level, though its triangles are not).
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ..execution.local_executor import in_turn
from ..simulation.simulate import MAX_SURFACES, Simulator

APART_M = 0.02  # of the surfaces of a column
COLUMNS_AT_ONCE = 65_536
SURFACES_AT_ONCE = 262_144  # whose planes are fitted: 30 numbers each
_PLANE_SUMS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))  # entries of the normal equations of a plane
FIT_PULL = 1e-3  # makes the plane of a lone cell level, and leaves every other one alone


@dataclass(frozen=True)
class Grid:
    """Cells of the ground plane, counted from the map's zero so that they do not depend on its bounds.

    Attributes:
        cell_m: edge of a cell.
        low: (2,) int64 number of the first column in x and y.
        size: (2,) int64 columns in x and y.
    """

    cell_m: float
    low: NDArray[np.int64]
    size: NDArray[np.int64]

    @classmethod
    def over(cls, low_m: NDArray[np.float64], high_m: NDArray[np.float64], cell_m: float) -> Grid:
        """The grid that covers the (2,) or (3,) corners."""
        first = np.floor(low_m[:2] / cell_m).astype(np.int64)
        last = np.floor(high_m[:2] / cell_m).astype(np.int64)
        return cls(cell_m, first, last - first + 1)

    def column_of(self, xy_m: NDArray[np.float64]) -> NDArray[np.int64]:
        """(n, 2) metres to (n, 2) column numbers counted from the grid's corner, maybe outside."""
        return np.floor(xy_m[:, :2] / self.cell_m).astype(np.int64) - self.low

    def contains(self, column: NDArray[np.int64]) -> NDArray[np.bool_]:
        """(n,) whether columns lie in the grid."""
        inside = (column >= 0) & (column < self.size)
        return inside[:, 0] & inside[:, 1]

    def centre_m(self, column: NDArray[np.int64]) -> NDArray[np.float64]:
        """(n, 2) column numbers to (n, 2) metres."""
        return (column + self.low).astype(np.float64) * self.cell_m + self.cell_m / 2


@dataclass(frozen=True)
class Surfaces:
    """Surfaces in the columns, sorted by column, lowest first.

    Attributes:
        column: (n, 2) int64 column numbers.
        z: (n,) metres.
        level: (n,) |z| of the triangle's normal.
        headroom_m: (n,) free height to the next surface above, inf under the open sky.
    """

    column: NDArray[np.int64]
    z: NDArray[np.float64]
    level: NDArray[np.float64]
    headroom_m: NDArray[np.float64]

    @classmethod
    def none(cls) -> Surfaces:
        """No surface."""
        return cls(np.zeros((0, 2), np.int64), np.zeros(0), np.zeros(0), np.zeros(0))

    def __len__(self) -> int:
        return len(self.z)

    def subset(self, keep: NDArray[np.bool_] | NDArray[np.int64]) -> Surfaces:
        """The chosen surfaces."""
        return Surfaces(self.column[keep], self.z[keep], self.level[keep], self.headroom_m[keep])

    def order(self) -> NDArray[np.int64]:
        """(n,) numbers by column, lowest first."""
        return np.lexsort((self.z, self.column[:, 1], self.column[:, 0]))


class ColumnIndex:
    """Finds the surfaces of a column. Surfaces must be sorted."""

    def __init__(self, grid: Grid, surfaces: Surfaces) -> None:
        self._grid, self._z = grid, surfaces.z
        flat = surfaces.column[:, 0] * grid.size[1] + surfaces.column[:, 1]
        self._start = np.searchsorted(flat, np.arange(int(np.prod(grid.size)) + 1))
        self.most = int(np.diff(self._start).max(initial=0))

    def nearest(
        self,
        column: NDArray[np.int64],
        z: NDArray[np.float64],
        within_m: float,
        *,
        below: bool = False,
    ) -> NDArray[np.int64]:
        """(n,) number of the surface of a column that is nearest to a height, -1 for none near enough.

        Args:
            column: (n, 2) column numbers, maybe outside the grid.
            below: only surfaces at the height or lower.
        """
        found = np.full(len(column), -1)
        best = np.full(len(column), within_m, np.float64)
        inside = self._grid.contains(column)
        flat = np.where(inside, column[:, 0] * self._grid.size[1] + column[:, 1], 0)
        start, end = self._start[flat], np.where(inside, self._start[flat + 1], 0)
        for rank in range(self.most):
            there = np.flatnonzero(start + rank < end)
            number = start[there] + rank
            drop = z[there] - self._z[number]
            distance = np.abs(drop)
            closer = (distance <= best[there]) & ((drop >= 0) | (not below))
            found[there[closer]] = number[closer]
            best[there[closer]] = distance[closer]
        return found


def find_surfaces(simulator: Simulator, grid: Grid, columns: NDArray[np.int64]) -> Surfaces:
    """All surfaces in the (n, 2) columns, of any slope."""
    slices = [columns[start : start + COLUMNS_AT_ONCE] for start in range(0, len(columns), COLUMNS_AT_ONCE)]
    parts = [Surfaces.none(), *(part for _, part in in_turn(partial(_surfaces, simulator, grid), slices))]
    surfaces = Surfaces(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Surfaces)))
    return surfaces.subset(surfaces.order())


def _surfaces(simulator: Simulator, grid: Grid, columns: NDArray[np.int64]) -> Surfaces:
    start, z, level = simulator.crossings(grid.centre_m(columns), APART_M, MAX_SURFACES)
    above = np.concatenate([[np.inf], z[:-1]])
    above[start[:-1][np.diff(start) > 0]] = np.inf  # the highest surface of a column
    return Surfaces(np.repeat(columns, np.diff(start), axis=0), z, level.astype(np.float64), above - z)


def fit_planes(
    grid: Grid, surfaces: Surfaces, reach_cells: int, step_m: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Each surface with its neighbours as a plane.

    Args:
        reach_cells: how far neighbours are taken.
        step_m: a neighbour may be this much higher or lower per cell of distance.

    Returns:
        (n,) height of the plane at the column's centre, (n,) its slope (rise over run).
    """
    index = ColumnIndex(grid, surfaces)
    plane_z, slope = np.empty(len(surfaces)), np.empty(len(surfaces))
    for start in range(0, len(surfaces), SURFACES_AT_ONCE):
        here = slice(start, start + SURFACES_AT_ONCE)
        column, z = surfaces.column[here], surfaces.z[here]
        plane = _planes_around(index, surfaces.z, column, z, grid.cell_m, reach_cells, step_m)
        plane_z[here], slope[here] = z + plane[:, 0], np.hypot(plane[:, 1], plane[:, 2])
    return plane_z, slope


def _planes_around(
    index: ColumnIndex,
    every_z: NDArray[np.float64],
    column: NDArray[np.int64],
    z: NDArray[np.float64],
    cell_m: float,
    reach_cells: int,
    step_m: float,
) -> NDArray[np.float64]:
    """(n, 3) plane through the neighbours of each of n surfaces: height over it, rise along x and y."""
    sums = np.zeros((len(_PLANE_SUMS), len(z)))
    right = np.zeros((3, len(z)))
    for number, (one, other) in enumerate(_PLANE_SUMS):
        sums[number] = FIT_PULL if one == other != 0 else 0.0
    for dx in range(-reach_cells, reach_cells + 1):
        for dy in range(-reach_cells, reach_cells + 1):
            reach = max(abs(dx), abs(dy), 1)
            near = index.nearest(column + np.array([dx, dy]), z, step_m * reach)
            there = near >= 0
            rise = np.where(there, every_z[near] - z, 0.0)
            row = (1.0, dx * cell_m, dy * cell_m)
            for number, (one, other) in enumerate(_PLANE_SUMS):
                sums[number] += there * (row[one] * row[other])
            for number in range(3):
                right[number] += row[number] * rise
    normal = np.empty((len(z), 3, 3))
    for number, (one, other) in enumerate(_PLANE_SUMS):
        normal[:, one, other] = normal[:, other, one] = sums[number]
    return np.asarray(np.linalg.solve(normal, right.T[..., None])[..., 0], np.float64)

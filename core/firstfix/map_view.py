"""Free space: does the scan see through what the map says is there?

A wrong place that looks alike overlaps well, since overlap asks only where returns lie. It has walls,
though, where the scan's rays went on: at right poses next to none do, at wrong ones some nearly always.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from small_gicp import voxelgrid_sampling

from .transform import Matrix

CELL_DEG = 2.0
TILE_M = 5.0
NEAR_M = 9.0
NEAR_VOXEL_M, FAR_VOXEL_M = 0.2, 0.4  # of the map's points: at 6 and at 12 m a cell is as wide
NEAREST_M = 0.3
TOLERANCE_M, TOLERANCE = 0.3, 0.03  # a surface is further if by more than this and this share of its range

_COLUMNS = round(360 / CELL_DEG)
_ROWS = round(180 / CELL_DEG)
_CELLS_A_RADIAN = np.float32(_COLUMNS / (2 * np.pi))


class MapView:
    """The map as it is seen from a pose: its nearest surface in every direction. Thread-safe.

    Args:
        points: (m, 3) metres, the map's.
        reach_m: how far surfaces are looked at.
    """

    def __init__(self, points: NDArray[np.floating], reach_m: float) -> None:
        self._near = _Tiles(points, NEAR_VOXEL_M, min(NEAR_M, reach_m))
        self._far = _Tiles(points, FAR_VOXEL_M, reach_m)

    def seen_through(self, scan: ScanView, T_level_sensor: Matrix) -> float:
        """Share of the directions, of those where both scan and map have something, in which every return
        in and around it lies beyond the map's surface.

        Returns:
            0..1; 1 where scan and map share no direction.
        """
        R, centre = T_level_sensor[:3, :3].astype(np.float32), T_level_sensor[:3, 3]
        away = np.concatenate([self._near.around(centre), self._far.around(centre)])
        mapped = nearest_by_direction(away @ R)
        both = np.isfinite(mapped) & scan.returned
        if not both.any():
            return 1.0
        beyond = scan.least[both] > mapped[both] * np.float32(1 + TOLERANCE) + np.float32(TOLERANCE_M)
        return float(beyond.mean())


class _Tiles:
    """Thinned points, those around a place at hand."""

    def __init__(self, points: NDArray[np.floating], voxel_m: float, reach_m: float) -> None:
        thinned = voxelgrid_sampling(np.asarray(points, np.float64), voxel_m).points()[:, :3]
        tile = np.floor(thinned[:, :2] / TILE_M).astype(np.int64)
        self._reach_m = reach_m
        self._low = tile.min(axis=0)
        self._size = tile.max(axis=0) - self._low + 1
        number = (tile - self._low) @ [self._size[1], 1]
        order = np.argsort(number, kind="stable")
        self._points = thinned[order].astype(np.float32)
        self._start = np.searchsorted(number[order], np.arange(int(self._size.prod()) + 1))

    def around(self, centre: NDArray[np.float64]) -> NDArray[np.float32]:
        """(n, 3) from the centre to every point within reach."""
        low = np.floor((centre[:2] - self._reach_m) / TILE_M).astype(np.int64) - self._low
        high = np.floor((centre[:2] + self._reach_m) / TILE_M).astype(np.int64) - self._low
        low, high = np.clip(low, 0, self._size), np.clip(high + 1, 0, self._size)
        columns = [
            self._points[self._start[x * self._size[1] + low[1]] : self._start[x * self._size[1] + high[1]]]
            for x in range(low[0], high[0])
        ]
        away = np.concatenate(columns or [self._points[:0]]) - centre.astype(np.float32)
        return away[np.einsum("ij,ij->i", away, away) < self._reach_m**2]


@dataclass(frozen=True)
class ScanView:
    """A scan seen from its sensor, made once for all the poses it is looked at from.

    Attributes:
        returned: (cells,) whether it has a return in that direction.
        least: (cells,) its nearest return in and around the direction, metres.
    """

    returned: NDArray[np.bool_]
    least: NDArray[np.float32]

    @classmethod
    def of(cls, points: NDArray[np.float32]) -> ScanView:
        """
        Args:
            points: (n, 3) some thousand returns, sensor frame.
        """
        nearest = nearest_by_direction(points)
        return cls(np.isfinite(nearest), _least_of_neighbours(nearest.reshape(_ROWS, _COLUMNS)).ravel())


def nearest_by_direction(points: NDArray[np.float32]) -> NDArray[np.float32]:
    """(n, 3) seen from the origin to the nearest range in each of (cells,) directions, inf where there is
    nothing."""
    x, y, z = np.ascontiguousarray(points.T)
    across2 = x * x + y * y
    distance = np.sqrt(across2 + z * z)
    column = ((np.arctan2(y, x) + np.float32(np.pi)) * _CELLS_A_RADIAN).astype(np.int32)
    row = ((np.arctan2(z, np.sqrt(across2)) + np.float32(np.pi / 2)) * _CELLS_A_RADIAN).astype(np.int32)
    cell = np.minimum(row, _ROWS - 1) * _COLUMNS + column % _COLUMNS
    image = np.full(_ROWS * _COLUMNS, np.inf, np.float32)
    far = distance > NEAREST_M
    np.minimum.at(image, cell[far], distance[far])
    return image


def _least_of_neighbours(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """Each cell's minimum with its eight neighbours; columns go round."""
    across = np.minimum(np.minimum(np.roll(image, 1, axis=1), np.roll(image, -1, axis=1)), image)
    least = across.copy()
    np.minimum(least[1:], across[:-1], out=least[1:])
    np.minimum(least[:-1], across[1:], out=least[:-1])
    return least

"""Free space: does the scan see through what the map says is there?

A wrong place that looks alike overlaps well, since overlap asks only where returns lie. It has walls,
though, where the scan's rays went on: at right poses next to none do, at wrong ones some nearly always.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .tiles import Tiles
from .transform import Matrix

CELL_DEG = 2.0
NEAR_M = 9.0
NEAR_VOXEL_M, FAR_VOXEL_M = 0.2, 0.4  # of the map's points: at 6 and at 12 m a cell is as wide
NEAREST_M = 0.3
TOLERANCE_M, TOLERANCE = 0.3, 0.03  # a surface is further if by more than this and this share of its range
_NEAR_FILE, _FAR_FILE = "view_near.safetensors", "view_far.safetensors"

_COLUMNS = round(360 / CELL_DEG)
_ROWS = round(180 / CELL_DEG)
_CELLS_A_RADIAN = np.float32(_COLUMNS / (2 * np.pi))


@dataclass(frozen=True)
class MapView:
    """The map as it is seen from a pose: its nearest surface in every direction. Thread-safe.

    Attributes:
        near, far: finely, and further away less so.
        reach_m: how far surfaces are looked at.
    """

    near: Tiles
    far: Tiles
    reach_m: float

    @classmethod
    def of(cls, points: NDArray[np.floating], reach_m: float) -> MapView:
        """
        Args:
            points: (m, 3) metres, the map's.
        """
        return cls(Tiles.of(points, NEAR_VOXEL_M), Tiles.of(points, FAR_VOXEL_M), reach_m)

    def save(self, directory: Path) -> None:
        self.near.save(directory / _NEAR_FILE)
        self.far.save(directory / _FAR_FILE)

    @classmethod
    def load(cls, directory: Path, reach_m: float) -> MapView:
        """Of a version's files, memory-mapped."""
        return cls(Tiles.load(directory / _NEAR_FILE), Tiles.load(directory / _FAR_FILE), reach_m)

    def seen_through(self, scan: ScanView, T_level_sensor: Matrix) -> float:
        """Share of the directions, of those where both scan and map have something, in which every return
        in and around it lies beyond the map's surface.

        Returns:
            0..1; 1 where scan and map share no direction.
        """
        R, centre = T_level_sensor[:3, :3].astype(np.float32), T_level_sensor[:3, 3]
        near = self.near.around(centre, min(NEAR_M, self.reach_m))
        away = np.concatenate([near, self.far.around(centre, self.reach_m)])
        mapped = nearest_by_direction(away @ R)
        both = np.isfinite(mapped) & scan.returned
        if not both.any():
            return 1.0
        beyond = scan.least[both] > mapped[both] * np.float32(1 + TOLERANCE) + np.float32(TOLERANCE_M)
        return float(beyond.mean())


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

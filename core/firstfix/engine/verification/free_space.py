"""Free space: does the scan see through what the map says is there?

A wrong place that looks alike overlaps well, since overlap asks only where returns lie. It has walls,
though, where the scan's rays went on: at right poses next to none do, at wrong ones some nearly always.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...scan.range_view import ScanView, nearest_by_direction
from ...transform import Matrix
from .point_tiles import Tiles

NEAR_M = 9.0
NEAR_VOXEL_M, FAR_VOXEL_M = 0.2, 0.4  # of the map's points: at 6 and at 12 m a cell is as wide
TOLERANCE_M, TOLERANCE = 0.3, 0.03  # a surface is further if by more than this and this share of its range
_NEAR_FILE, _FAR_FILE = "view_near.safetensors", "view_far.safetensors"


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

    def free_space_violation(self, scan: ScanView, T_level_sensor: Matrix) -> float:
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

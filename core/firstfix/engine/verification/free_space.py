"""Free-space check: do rays of the scan pass through surfaces of the map?

A wrong pose in a place that looks alike may have a high inlier ratio, because that looks only at the ends of
rays. But there some rays nearly always pass through walls of the map; at right poses almost none do.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ... import native
from ...scan.range_view import RangeView
from ...transform import Matrix
from .point_tiles import PointTiles

NEAR_VOXEL_M, FAR_VOXEL_M = 0.2, 0.4  # of the map's points: at 6 and at 12 m a cell is as wide
_NEAR_FILE, _FAR_FILE = "view_near.safetensors", "view_far.safetensors"


@dataclass(frozen=True)
class MapView:
    """Map points to look at from a pose, direction by direction. Thread-safe.

    Attributes:
        near: fine points, for surfaces within 9 m.
        far: coarser points, for all surfaces.
        reach_m: distance up to which surfaces are checked.
    """

    near: PointTiles
    far: PointTiles
    reach_m: float

    @classmethod
    def of(cls, points: NDArray[np.floating], reach_m: float) -> MapView:
        """View of a map.

        Args:
            points: (m, 3) metres, of the map.
            reach_m: distance up to which surfaces are checked.
        """
        return cls(PointTiles.of(points, NEAR_VOXEL_M), PointTiles.of(points, FAR_VOXEL_M), reach_m)

    def save(self, directory: Path) -> None:
        """Writes a version's files."""
        self.near.save(directory / _NEAR_FILE)
        self.far.save(directory / _FAR_FILE)

    @classmethod
    def load(cls, directory: Path, reach_m: float) -> MapView:
        """Reads a version's files, memory-mapped."""
        return cls(PointTiles.load(directory / _NEAR_FILE), PointTiles.load(directory / _FAR_FILE), reach_m)

    def free_space_violation(self, scan: RangeView, T_level_sensor: Matrix) -> float:
        """Share of directions in which the scan sees through the map.

        Directions count in which both scan and map have a surface. The scan sees through the map if its
        nearest return in and around the direction lies beyond the map's surface by 0.3 m and 3 %.

        Returns:
            0..1; 1 if scan and map have no direction in common.
        """
        near, far = self.near.tables, self.far.tables
        return native.free_space_violation(near, far, self.reach_m, scan.returned, scan.least, T_level_sensor)

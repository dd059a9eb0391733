"""Points with the times at which they were taken, filtered together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..portable.sample import rows_by_chance
from .voxel_filter import (
    BORDER_M,
    is_within_range,
    rows_by_voxel_hash,
    voxel_mean_times,
    voxel_means,
    within_range,
)


@dataclass(frozen=True)
class TimedPoints:
    """Points, and their times where these are known.

    Attributes:
        points: (n, 3) metres, float32; means of voxels float64.
        time_s: (n,) float32 seconds from the scan's stamp, or None.
    """

    points: NDArray[np.floating]
    time_s: NDArray[np.float32] | None

    def at(self, rows: NDArray[np.integer] | NDArray[np.bool_]) -> TimedPoints:
        """The given rows."""
        return TimedPoints(self.points[rows], None if self.time_s is None else self.time_s[rows])

    def within_range(self, min_range_m: float, max_range_m: float) -> TimedPoints:
        """Points whose distance from the sensor lies between two limits (``voxel_filter.within_range``)."""
        if self.time_s is None:
            return TimedPoints(within_range(self.points, min_range_m, max_range_m), None)
        return self.at(is_within_range(self.points, min_range_m, max_range_m))

    def at_most(self, count: int) -> TimedPoints:
        """At most ``count`` of the points, in their order (``rows_by_chance``)."""
        return self if len(self.points) <= count else self.at(rows_by_chance(len(self.points), count))

    def voxel_means(self, voxel_m: float) -> TimedPoints:
        """Mean point and mean time of every voxel. The voxels have a border at BORDER_M."""
        means = voxel_means(self.points, voxel_m, BORDER_M)
        if self.time_s is None:
            return TimedPoints(means, None)
        times = voxel_mean_times(self.points, self.time_s, voxel_m, BORDER_M)
        return TimedPoints(means, times.astype(np.float32))

    def by_voxel_hash(self, voxel_m: float, at_most: int) -> TimedPoints:
        """An even part of the points, float32 (``rows_by_voxel_hash``)."""
        chosen = self.at(rows_by_voxel_hash(self.points, voxel_m, at_most))
        return TimedPoints(chosen.points.astype(np.float32), chosen.time_s)

"""Points of a map as a sensor sees them from a place: no surface is made, and no ray is cast."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firstfix.scan.reduction import CELL_DEG, cells_of, nearest_by_direction
from firstfix.sensor import SensorModel

RAYS = 4096  # of the sensor, that tell its field of view
# A point hides those that are further away in its direction by more than this: a floor rises within a cell.
BEHIND_SHARE, BEHIND_M = 0.06, 0.5


@dataclass(frozen=True)
class SensorView:
    """Field of view of a level sensor.

    Attributes:
        low_sine, high_sine: of the lowest and the highest elevation.
        min_range_m, max_range_m: of its returns.
    """

    low_sine: float
    high_sine: float
    min_range_m: float
    max_range_m: float

    @classmethod
    def of(cls, sensor: SensorModel) -> SensorView:
        """View of a sensor at any heading, half a cell wider than its lowest and highest rays."""
        rise = sensor.coarser(RAYS).directions_at_any_heading()[:, 2]
        wider = float(np.radians(CELL_DEG / 2))
        low, high = float(rise.min()) - wider, float(rise.max()) + wider
        return cls(low, high, sensor.min_range_m, sensor.max_range_m)

    def seen(self, points: NDArray[np.float32]) -> NDArray[np.float32]:
        """Points, of (n, 3), that the sensor at the origin sees: all that no nearer point hides."""
        x, y, z = points.T
        range_m = np.sqrt(x * x + y * y + z * z)
        rise = z / np.maximum(range_m, np.float32(1e-6))
        kept = (range_m > self.min_range_m) & (range_m < self.max_range_m)
        kept &= (rise >= self.low_sine) & (rise <= self.high_sine)
        near = np.ascontiguousarray(points[kept])
        nearest_m = nearest_by_direction(near)[cells_of(near)]
        return near[range_m[kept] <= nearest_m * (1 + BEHIND_SHARE) + BEHIND_M]

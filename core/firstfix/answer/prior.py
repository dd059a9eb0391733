"""Where the caller already knows the robot to be: a radius, and maybe a range of headings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidOption
from ..transform import Matrix, yaw_of

MAX_RADIUS_M = 1e6


@dataclass(frozen=True)
class Prior:
    """The sensor is within a sphere, with its x axis within a range of headings.

    Attributes:
        position_m: (3,) map frame.
        radius_m: above 0.
        yaw_deg, yaw_range_deg: heading in the map and how far to either side of it; 180: any.
    """

    position_m: NDArray[np.float64]
    radius_m: float
    yaw_deg: float = 0.0
    yaw_range_deg: float = 180.0

    @classmethod
    def from_numbers(cls, numbers: Sequence[float]) -> Prior:
        """From x, y, z, radius_m and, it may be, yaw_deg, yaw_range_deg.

        Raises:
            InvalidOption: a radius or range that is none.
        """
        x, y, z, radius_m, *heading = numbers
        yaw_deg, yaw_range_deg = heading or (0.0, 180.0)
        if not 0 < radius_m <= MAX_RADIUS_M:
            raise InvalidOption(f"prior: a radius lies in (0, {MAX_RADIUS_M:g}] m, not {radius_m}")
        if not 0 < yaw_range_deg <= 180:
            raise InvalidOption(f"prior: a range of headings lies in (0, 180] degrees, not {yaw_range_deg}")
        return cls(np.array([x, y, z], np.float64), radius_m, yaw_deg, yaw_range_deg)

    def to_numbers(self) -> list[float]:
        place = [*(float(v) for v in self.position_m), self.radius_m]
        return place if self.yaw_range_deg >= 180 else [*place, self.yaw_deg, self.yaw_range_deg]

    def allows(self, T_map_sensor: Matrix, slack_m: float = 0.0, slack_deg: float = 0.0) -> bool:
        """Whether a pose agrees with it, up to some slack for one that is not registered yet."""
        away_m = float(np.linalg.norm(T_map_sensor[:3, 3] - self.position_m))
        off = math.degrees(yaw_of(T_map_sensor)) - self.yaw_deg
        turned_deg = abs((off + 180) % 360 - 180)
        return away_m <= self.radius_m + slack_m and turned_deg <= self.yaw_range_deg + slack_deg

"""Prior: the region and headings in which the caller knows the robot to be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidOption
from ..transform import Matrix

MAX_RADIUS_M = 1e6


@dataclass(frozen=True)
class Prior:
    """Sphere that contains the sensor, and range of headings of its x axis.

    Attributes:
        position_m: (3,) centre in the map frame.
        radius_m: above 0.
        yaw_deg: middle of the headings, in the map.
        yaw_range_deg: largest difference from ``yaw_deg`` to either side; 180: any heading.
    """

    position_m: NDArray[np.float64]
    radius_m: float
    yaw_deg: float = 0.0
    yaw_range_deg: float = 180.0

    @classmethod
    def from_numbers(cls, numbers: Sequence[float]) -> Prior:
        """Prior from x, y, z, radius_m and optionally yaw_deg, yaw_range_deg.

        Raises:
            InvalidOption: the radius or the range of headings is out of range.
        """
        x, y, z, radius_m, *heading = numbers
        yaw_deg, yaw_range_deg = heading or (0.0, 180.0)
        if not 0 < radius_m <= MAX_RADIUS_M:
            raise InvalidOption(f"prior: radius_m must lie in (0, {MAX_RADIUS_M:g}], not {radius_m}")
        if not 0 < yaw_range_deg <= 180:
            raise InvalidOption(f"prior: yaw_range_deg must lie in (0, 180], not {yaw_range_deg}")
        return cls(np.array([x, y, z], np.float64), radius_m, yaw_deg, yaw_range_deg)

    def to_numbers(self) -> list[float]:
        """Numbers that ``from_numbers`` reads."""
        sphere = [*(float(v) for v in self.position_m), self.radius_m]
        return sphere if self.yaw_range_deg >= 180 else [*sphere, self.yaw_deg, self.yaw_range_deg]

    def allows(self, T_map_sensor: Matrix, slack_m: float = 0.0, slack_deg: float = 0.0) -> bool:
        """Whether a pose agrees with the prior, with slack for a pose that is not registered yet."""
        return bool(self.allows_each(T_map_sensor[None], slack_m, slack_deg)[0])

    def allows_each(
        self, T_map_sensor: NDArray[np.float64], slack_m: float = 0.0, slack_deg: float = 0.0
    ) -> NDArray[np.bool_]:
        """Whether each of (k, 4, 4) poses agrees with the prior, as ``allows`` does."""
        away_m = np.linalg.norm(T_map_sensor[:, :3, 3] - self.position_m, axis=1)
        off = np.degrees(np.arctan2(T_map_sensor[:, 1, 0], T_map_sensor[:, 0, 0])) - self.yaw_deg
        turned_deg = np.abs((off + 180) % 360 - 180)
        is_near: NDArray[np.bool_] = away_m <= self.radius_m + slack_m
        return is_near & (turned_deg <= self.yaw_range_deg + slack_deg)

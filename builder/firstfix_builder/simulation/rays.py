"""Rays of a sensor, made once and moved from pose to pose."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from firstfix.native import bundle_rays
from firstfix.scan.levelling import turned
from firstfix.sensor import SensorModel
from firstfix.transform import Matrix

KEPT = 24  # sensors, and moments of those that scan no rows


@dataclass(frozen=True)
class Rays:
    """Unit rays from one origin.

    Attributes:
        directions: (n, 3) float32.
        order: (n,) uint32, their rows in the order in which neighbours are cast together.
    """

    directions: NDArray[np.float32]
    order: NDArray[np.uint32]

    def __len__(self) -> int:
        return len(self.directions)

    @classmethod
    def of(cls, directions: NDArray[np.float32]) -> Rays:
        """Rays of (n, 3) unit directions."""
        rays = np.array(directions, np.float32, order="C")
        rays.setflags(write=False)
        return cls(rays, bundle_rays(rays))

    @staticmethod
    def of_sensor(sensor: SensorModel) -> Rays:
        """``sensor.directions()``, in the sensor frame."""
        return _of_sensor(sensor)

    @staticmethod
    def of_scan(sensor: SensorModel, moment: int) -> Rays:
        """``sensor.scan_directions(moment)``, in the sensor frame."""
        return _of_sensor(sensor) if sensor.looks_around else _of_scan(sensor, moment)

    @staticmethod
    def at_any_heading(sensor: SensorModel) -> Rays:
        """``sensor.directions_at_any_heading()``, in the frame of a level robot."""
        return _at_any_heading(sensor)

    def of_rows(self, chosen: NDArray[np.bool_]) -> Rays:
        """The chosen ones of n rays, in the same order."""
        number = (np.cumsum(chosen) - 1).astype(np.uint32)
        directions = np.ascontiguousarray(self.directions[chosen])
        return Rays(directions, number[self.order[chosen[self.order]]])

    def turned(self, T: Matrix) -> Rays:
        """The rays, rotated from the right frame of T to its left frame, in the same order."""
        return Rays(np.ascontiguousarray(turned(self.directions, T[:3, :3])), self.order)


@lru_cache(KEPT)
def _of_sensor(sensor: SensorModel) -> Rays:
    return Rays.of(sensor.directions())


@lru_cache(KEPT)
def _of_scan(sensor: SensorModel, moment: int) -> Rays:
    return Rays.of(sensor.scan_directions(moment))


@lru_cache(KEPT)
def _at_any_heading(sensor: SensorModel) -> Rays:
    return Rays.of(sensor.directions_at_any_heading())

"""Simulates scans of a sensor in motion: each column is seen from the sensor's position at its time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from firstfix.sensor import SensorModel
from firstfix.transform import Matrix

from .rays import Rays
from .simulate import Simulator


@dataclass(frozen=True)
class Sweep:
    """One revolution of a spinning sensor.

    Attributes:
        period_s: of a revolution.
        stamp: position of the stamp in the revolution: 0 at its start, 0.5 in its middle, 1 at its end.
        cut_rad: azimuth at which the revolution begins and ends.
        clockwise: seen from above.
    """

    period_s: float = 0.1
    stamp: float = 0.5
    cut_rad: float = np.pi
    clockwise: bool = True

    def times(self, directions: NDArray[np.floating]) -> NDArray[np.float32]:
        """Seconds (n,) from the stamp at which the sensor looks into (n, 3) directions of its frame."""
        azimuth = np.arctan2(directions[:, 1], directions[:, 0])
        turned = (self.cut_rad - azimuth) if self.clockwise else (azimuth - self.cut_rad)
        return ((turned / (2 * np.pi) % 1.0 - self.stamp) * self.period_s).astype(np.float32)


@dataclass(frozen=True)
class Motion:
    """Steady motion of a sensor while it turns.

    Attributes:
        twist: in the sensor frame: m/s along x, y, z, then rad/s about them.
        sweep: the revolution.
    """

    twist: tuple[float, float, float, float, float, float]
    sweep: Sweep = Sweep()


def moving_ranges(
    simulator: Simulator, sensor: SensorModel, T_map_sensor: Matrix, motion: Motion, rays: Rays
) -> NDArray[np.float32]:
    """Clean ranges (n,) of a sensor's rays, inf where there is no return.

    The times of the rays are ``motion.sweep.times`` of their directions.

    Args:
        T_map_sensor: (4, 4) at the stamp.
        rays: unit rays in the sensor frame.
    """
    directions = rays.directions
    # the rays of a column share one moment
    moments, of_ray = np.unique(motion.sweep.times(directions), return_inverse=True)
    R, t = poses_along(motion.twist, moments)
    R, t = T_map_sensor[:3, :3] @ R, t @ T_map_sensor[:3, :3].T + T_map_sensor[:3, 3]
    ranges = simulator.cast(t[of_ray], np.einsum("nij,nj->ni", R[of_ray], directions))
    ranges[(ranges < sensor.min_range_m) | (ranges > sensor.max_range_m)] = np.inf
    return ranges


def poses_along(
    twist: Sequence[float], time_s: NDArray[np.floating]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Rotations (n, 3, 3) and positions (n, 3) of a sensor in its own frame at time 0, for a steady twist."""
    way, turn = time_s[:, None] * np.asarray(twist[:3]), time_s[:, None] * np.asarray(twist[3:])
    angle = np.linalg.norm(turn, axis=1)[:, None]
    near = angle < 1e-6
    safe = np.where(near, 1.0, angle)
    once = np.where(near, 0.5, (1 - np.cos(safe)) / safe**2)
    twice = np.where(near, 1 / 6, (safe - np.sin(safe)) / safe**3)
    across = np.cross(turn, way)
    return Rotation.from_rotvec(turn).as_matrix(), way + once * across + twice * np.cross(turn, across)

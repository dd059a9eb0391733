"""The watch over a robot's own localization: says when it has gone astray."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from firstfix.transform import Matrix, inverse, rotation_angle_deg, yaw_of

from .config import GatewayConfig

SIGMAS = 3.0  # an offset counts as far as it exceeds so many standard deviations of the fix
AGREE_M, AGREE_DEG = 0.5, 10.0  # of two fixes, after the robot's motion between them


class Health(str, Enum):
    """State of the robot's own localization, as its watch sees it."""

    UNKNOWN = "unknown"  # it is not heard, or no scan was localized yet
    HEALTHY = "healthy"
    SUSPECT = "suspect"  # one fix contradicts it; the next one decides
    ASTRAY = "astray"  # two fixes that agree contradict it


@dataclass(frozen=True)
class Offset:
    """Difference of two poses.

    Attributes:
        vector_m: (3,) in the map; its z is 0 if only the plane is compared.
    """

    vector_m: NDArray[np.float64]
    angle_deg: float

    @property
    def distance_m(self) -> float:
        """Length of the vector."""
        return float(np.linalg.norm(self.vector_m))


def offset_of(T_map_a: Matrix, T_map_b: Matrix, *, planar: bool) -> Offset:
    """The offset from pose a to pose b.

    Args:
        planar: compare x, y and heading alone, because one of the poses knows no height and no tilt.
    """
    vector_m = T_map_b[:3, 3] - T_map_a[:3, 3]
    if not planar:
        return Offset(vector_m, rotation_angle_deg(T_map_a[:3, :3].T @ T_map_b[:3, :3]))
    turn_deg = np.degrees(yaw_of(T_map_b) - yaw_of(T_map_a))
    return Offset(vector_m * [1, 1, 0], float(abs((turn_deg + 180) % 360 - 180)))


def is_near(T_map_a: Matrix, T_map_b: Matrix, config: GatewayConfig, *, planar: bool) -> bool:
    """Whether two poses differ by no more than the limits of a robot astray.

    Args:
        planar: one of them knows no height and no tilt.
    """
    offset = offset_of(T_map_a, T_map_b, planar=planar)
    return offset.distance_m <= config.astray_m and offset.angle_deg <= config.astray_deg


@dataclass(frozen=True)
class Comparison:
    """A fix, with the robot's own pose at the same time.

    Attributes:
        T_map_fix: (4, 4) pose of a frame of the robot.
        covariance: (6, 6) of this pose.
        T_map_own: (4, 4) pose of the same frame by the robot's own localization.
        T_odom: (4, 4) pose of the same frame in the odometry's frame; None if not known.
        planar: the robot's own localization knows no height and no tilt.
        own_explains: the scan fits the map at the robot's own pose nearly as well as at the fix.
    """

    T_map_fix: Matrix
    covariance: NDArray[np.float64]
    T_map_own: Matrix
    T_odom: Matrix | None
    planar: bool
    own_explains: bool


class Watch:
    """Decides from fixes whether the robot's own localization has gone astray.

    One fix is not enough: the next one must agree with it, after the robot's own motion between the two.

    Args:
        astray_m, astray_deg: offsets beyond which a fix contradicts the robot's own pose.
    """

    def __init__(self, astray_m: float, astray_deg: float) -> None:
        self.astray_m, self.astray_deg = astray_m, astray_deg
        self.health = Health.UNKNOWN
        self.offset: Offset | None = None
        self._pending: Comparison | None = None

    def reset(self) -> None:
        """Forget what was seen: the robot was given a new pose, or its own localization is silent."""
        self.health, self.offset, self._pending = Health.UNKNOWN, None, None

    def see(self, comparison: Comparison) -> Health:
        """Take a fix and return the health after it."""
        offset = offset_of(comparison.T_map_own, comparison.T_map_fix, planar=comparison.planar)
        self.offset = offset
        distance_m, angle_deg = _surely(offset, comparison.covariance)
        if distance_m <= self.astray_m and angle_deg <= self.astray_deg:
            self.health, self._pending = Health.HEALTHY, None
        elif comparison.own_explains:
            pass  # says nothing for either pose
        elif self._pending is not None and _agree(self._pending, comparison):
            self.health, self._pending = Health.ASTRAY, comparison
        else:
            self._pending = comparison
            if self.health is not Health.ASTRAY:
                self.health = Health.SUSPECT
        return self.health


def _surely(offset: Offset, covariance: NDArray[np.float64]) -> tuple[float, float]:
    """The distance and the angle less ``SIGMAS`` standard deviations of the fix."""
    distance_m = offset.distance_m
    if distance_m > 0:
        direction = offset.vector_m / distance_m
        distance_m -= SIGMAS * math.sqrt(max(0.0, float(direction @ covariance[:3, :3] @ direction)))
    return distance_m, offset.angle_deg - SIGMAS * _angle_sigma_deg(covariance)


def _angle_sigma_deg(covariance: NDArray[np.float64]) -> float:
    largest = float(np.linalg.eigvalsh(covariance[3:, 3:])[-1])
    return math.degrees(math.sqrt(max(0.0, largest)))


def _agree(before: Comparison, now: Comparison) -> bool:
    if before.T_odom is not None and now.T_odom is not None:
        motion = inverse(before.T_odom) @ now.T_odom
    else:  # the robot's own localization may be at a wrong place, and still follow the robot's motion
        motion = inverse(before.T_map_own) @ now.T_map_own
    offset = offset_of(before.T_map_fix @ motion, now.T_map_fix, planar=False)
    distance_m, angle_deg = _surely(offset, before.covariance + now.covariance)
    return distance_m <= AGREE_M and angle_deg <= AGREE_DEG

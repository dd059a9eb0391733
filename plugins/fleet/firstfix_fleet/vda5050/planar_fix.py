"""The fix of a vehicle that moves in the plane, from an answer in space."""

from __future__ import annotations

import math
from dataclasses import dataclass

from firstfix.answer.localization import Localization
from firstfix.transform import yaw_of


@dataclass(frozen=True)
class PlanarFix:
    """Pose of a vehicle in a map, in the plane.

    Attributes:
        map_id, map_version: firstfix's.
        theta_rad: heading, -pi to pi.
    """

    map_id: str
    map_version: str
    x_m: float
    y_m: float
    theta_rad: float


@dataclass(frozen=True)
class NoFix:
    """No pose that may be sent, and why."""

    reason: str


def planar_fix(answer: Localization, max_tilt_deg: float) -> PlanarFix | NoFix:
    """The pose of an answer in the plane, where the promise covers it.

    Args:
        answer: to a query with ``T_base_sensor``.
        max_tilt_deg: largest angle between the vehicle's z and the map's.
    """
    T = answer.T_map_base
    if answer.T_map_sensor is None:
        reasons = ", ".join(reason.value for reason in answer.reasons)
        return NoFix(f"the scan is {answer.verdict.value}" + (f" ({reasons})" if reasons else ""))
    if T is None:
        return NoFix("the service gives no pose of the vehicle, only of its sensor")
    if answer.map_provisional:  # its probabilities were not measured
        return NoFix("the map's version is provisional: its promise is not measured yet")
    if answer.degenerate:  # the pose is right but for a shift along a corridor, which x and y do not show
        motions = ", ".join(sorted({one.motion.value for one in answer.degenerate}))
        return NoFix(f"the scan leaves the pose free ({motions})")
    tilt_deg = math.degrees(math.acos(min(1.0, max(-1.0, float(T[2, 2])))))
    if not tilt_deg <= max_tilt_deg:
        return NoFix(f"the pose is tilted by more than {max_tilt_deg:g} degrees")
    x_m, y_m, theta_rad = float(T[0, 3]), float(T[1, 3]), yaw_of(T)
    if not all(map(math.isfinite, (x_m, y_m, theta_rad))):
        return NoFix("the service gives a pose that is not finite")
    return PlanarFix(answer.map_id, answer.map_version, x_m, y_m, theta_rad)

"""A fix, moved on by the robot's odometry since."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from firstfix.ros.header import Stamp
from firstfix.ros.pose_message import covariance_of_base
from firstfix.transform import Matrix, inverse, rotation_angle_deg

from .query import Fix
from .senses import Senses

MAX_CARRIED_M = 50.0  # farther, a new search is better than odometry that has drifted
MAX_GAP_S = 2.0  # odometry that was silent for longer may have begun anew
# A step that differs from a smooth motion by more than this is none: the odometry was set back.
MAX_JUMP_M, MAX_ACCELERATION_M_S2 = 1.0, 10.0
MAX_JUMP_DEG, MAX_TURN_DEG_S = 30.0, 360.0
MAX_SPEED_M_S = 50.0  # of the first step
MIN_STEP_S = 0.2  # between two samples that are looked at: odometry may come at 200 Hz
# Standard deviations that good odometry of wheels adds for each metre of the way.
DRIFT_M_PER_M = 0.02
DRIFT_RAD_PER_M = math.radians(0.5)


class CarriedFix:
    """Follows one robot's odometry from a fix on.

    Args:
        clock: seconds that never go back.

    Attributes:
        fix: at its own time.
        way_m: length of the way since the fix, as far as it was followed.
    """

    def __init__(self, fix: Fix, senses: Senses, clock: Callable[[], float]) -> None:
        self.fix = fix
        self._senses, self._clock = senses, clock
        self.way_m = 0.0
        self._T_odom_frame, self._stamp = fix.T_odom_frame, fix.stamp
        self._heard_s = clock()
        self._velocity_m_s: NDArray[np.float64] | None = None  # (3,) in the odometry's frame
        self._is_broken = False

    @property
    def has_odometry(self) -> bool:
        """Whether the odometry was known at the time of the fix. If not, the fix cannot be moved."""
        return self.fix.T_odom_frame is not None

    def now(self) -> Fix | None:
        """The fix at the time of the last odometry. Call it ten times a second or so.

        Returns:
            with the drift of the odometry added to its covariance; None if the robot's motion since the fix
            is not known, or its way too long.
        """
        if self.fix.T_odom_frame is None or self._T_odom_frame is None:
            return None
        self._follow()
        if self._is_broken or self._clock() - self._heard_s > MAX_GAP_S:
            return None
        T_map_frame = self.fix.T_map_frame @ inverse(self.fix.T_odom_frame) @ self._T_odom_frame
        covariance = covariance_of_base(self.fix.T_map_frame, T_map_frame, self.fix.covariance)
        sigmas = np.repeat([DRIFT_M_PER_M, DRIFT_RAD_PER_M], 3) * self.way_m
        covariance = covariance + np.diag(sigmas**2)
        return Fix(self.fix.frame, self._stamp, T_map_frame, covariance, self._T_odom_frame)

    def _follow(self) -> None:
        """Move on along all samples that have come since the last call."""
        stamps = self._senses.odometry_stamps(self._stamp)
        newest = self._senses.odometry_stamp()
        was_set_back = newest is None or self._stamp.ns - newest.ns > MAX_GAP_S * 1e9
        self._is_broken |= was_set_back
        before = self._stamp
        for stamp in stamps:
            self._is_broken |= stamp.ns - before.ns > MAX_GAP_S * 1e9
            before = stamp
            if stamp is stamps[-1] or stamp.ns - self._stamp.ns >= MIN_STEP_S * 1e9:
                T_odom_frame = self._senses.odometry(self.fix.frame, stamp)
                if T_odom_frame is not None:
                    self._step(stamp, T_odom_frame)

    def _step(self, stamp: Stamp, T_odom_frame: Matrix) -> None:
        assert self._T_odom_frame is not None
        seconds = (stamp.ns - self._stamp.ns) / 1e9
        step_m = T_odom_frame[:3, 3] - self._T_odom_frame[:3, 3]
        turn_deg = rotation_angle_deg(self._T_odom_frame[:3, :3].T @ T_odom_frame[:3, :3])
        self._is_broken |= not (
            self._is_smooth(step_m, seconds) and turn_deg <= MAX_JUMP_DEG + MAX_TURN_DEG_S * seconds
        )
        self.way_m += float(np.linalg.norm(step_m))
        self._is_broken |= self.way_m > MAX_CARRIED_M
        self._T_odom_frame, self._stamp, self._heard_s = T_odom_frame, stamp, self._clock()
        self._velocity_m_s = step_m / seconds

    def _is_smooth(self, step_m: NDArray[np.float64], seconds: float) -> bool:
        if self._velocity_m_s is None:
            return float(np.linalg.norm(step_m)) <= MAX_JUMP_M + MAX_SPEED_M_S * seconds
        change_m = float(np.linalg.norm(step_m - self._velocity_m_s * seconds))
        return change_m <= MAX_JUMP_M + MAX_ACCELERATION_M_S2 * seconds**2 / 2

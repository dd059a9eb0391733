"""Odometry that is heard only after a fix: it completes the fix, or calls for a new one."""

from __future__ import annotations

import threading
from dataclasses import dataclass, replace

from .config import GatewayConfig
from .query import Fix
from .senses import Senses


@dataclass(frozen=True)
class Late:
    """Result of a look for late odometry. Empty: nothing is to be done.

    Attributes:
        completed: the fix with the pose of its frame by odometry.
        search: odometry has begun too long after the fix, so that the motion between them is not known.
    """

    completed: Fix | None = None
    search: bool = False


_NOTHING = Late()


class LateOdometry:
    """Waits for the odometry of a fix, which ``map_frame`` -> ``odom_frame`` needs. Thread-safe.

    Messages of different topics keep no order: a cloud may be answered before the odometry of its time is
    heard, above all the first one. A robot's odometry may also start after its LiDAR.
    """

    def __init__(self, config: GatewayConfig, senses: Senses) -> None:
        self._config, self._senses = config, senses
        self._lock = threading.Lock()
        self._fix: Fix | None = None  # that waits
        self._has_searched = False  # since the last fix whose odometry was known

    @property
    def is_awaited(self) -> bool:
        """True while odometry is waited for."""
        with self._lock:
            return self._waiting() is not None

    def begin(self, fix: Fix) -> None:
        """Take a new fix. It waits if its odometry is not known."""
        with self._lock:
            self._fix = None
            if fix.T_odom_frame is None:
                self._fix = fix
            else:
                self._has_searched = False

    def end(self) -> None:
        """Forget the fix: a new one is searched for."""
        with self._lock:
            self._fix = None

    def look(self) -> Late:
        """Outcome of the fix that waits; each is returned once."""
        with self._lock:
            fix = self._waiting()
            if fix is None:
                return _NOTHING
            T_odom_frame = self._senses.odometry(fix.frame, fix.stamp)
            if T_odom_frame is not None:
                self._fix, self._has_searched = None, False
                return Late(completed=replace(fix, T_odom_frame=T_odom_frame))
            if self._has_searched or not self._has_begun_after(fix):
                return _NOTHING
            self._fix, self._has_searched = None, True  # once: odometry with another clock stays unknown
            return Late(search=True)

    def _has_begun_after(self, fix: Fix) -> bool:
        newest = self._senses.odometry_stamp()
        if newest is None or newest <= fix.stamp:
            return False
        return self._senses.odometry(fix.frame, newest) is not None

    def _waiting(self) -> Fix | None:
        if not self._config.publishes_tf or self._senses.others_publish_map:
            return None
        return self._fix

"""Hands a fix to the robot's localizer: its pose is published again until the localizer follows it."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from firstfix.ros.header import Stamp

from .carried_fix import CarriedFix
from .config import GatewayConfig
from .query import Fix
from .senses import OwnLocalization, Senses
from .watch import is_near

STANDS_M = 0.1  # a robot that moved less stands
LISTEN_S = 5.0  # a localizer that runs is surely heard within this time
HEARD_S = 1.0  # and usually within this
LOOK_S = 0.5  # between two looks at the odometry and the localizer


class Stage(str, Enum):
    """How far a fix has come on its way into the robot's localizer."""

    PUBLISHED = "published"  # once, or its localizer is not heard
    WAITING = "waiting for a localizer"  # nobody subscribes to the pose
    REPEATED = "repeated"  # until the localizer follows
    FOLLOWED = "followed"  # the localizer's own pose agrees
    OLD = "too old to be repeated"


@dataclass(frozen=True)
class Due:
    """The next step of a handover.

    Attributes:
        repeat: the pose to be published again.
        search: a localizer has come, and no pose is left for it: a new search is needed.
    """

    repeat: Fix | None = None
    search: bool = False


NOTHING = Due()


class Handover:
    """One robot's handover. Thread-safe.

    The pose that is repeated is the fix moved by the odometry since, with its time. Without odometry it is
    the fix itself, as long as it is young. It is repeated

    * when a subscriber appears,
    * while the robot's own localization is heard elsewhere than the fix,
    * while nothing is heard of it, for ``young_s`` after a subscriber has appeared and while the robot
      stands: a localizer that works unheard must not be set back again and again,

    and never more often than every ``repeat_s``. When a localizer comes for which no pose is left, or one
    comes in the place of one that had followed, a new search is due.
    """

    def __init__(self, config: GatewayConfig, senses: Senses, clock: Callable[[], float]) -> None:
        self._config, self._senses, self._clock = config, senses, clock
        self._lock = threading.Lock()
        self._carried: CarriedFix | None = None
        self._stage = Stage.PUBLISHED
        self._localizers = 0  # subscribers at the last look
        self._came_s = self._sent_s = self._begin_s = self._next_look_s = clock()
        self._is_awaited = False  # by a subscriber that has come since the pose was published last
        self._listens_until_s: float | None = None  # whether a localizer that has followed still runs
        self._silent_at: Stamp | None = None  # of the newest messages when it began to listen

    @property
    def stage(self) -> Stage | None:
        """How far the fix has come; None if there is none."""
        with self._lock:
            return None if self._carried is None else self._stage

    @property
    def listens(self) -> bool:
        """True while the robot's own localization and its odometry must be heard."""
        with self._lock:
            if self._carried is None or not self._config.repeat_s:
                return False
            return self._stage is not Stage.FOLLOWED or self._listens_until_s is not None

    def begin(self, fix: Fix, localizers: int | None, *, published: bool) -> None:
        """Take a fix.

        Args:
            localizers: subscribers of the pose now; None if not known.
            published: its pose has just been published. If not, the localizer may follow it already, and has
                ``HEARD_S`` to be heard.
        """
        with self._lock:
            self._carried = CarriedFix(fix, self._senses, self._clock)
            self._stage = Stage.PUBLISHED if published else Stage.REPEATED
            self._begin_s = self._came_s = self._next_look_s = self._clock()
            if not published:
                self._sent_s = self._begin_s + HEARD_S - self._config.repeat_s
            else:  # or nobody has heard it
                self._sent_s = -math.inf if localizers == 0 else self._begin_s
            self._localizers, self._is_awaited = localizers or 0, not published
            self._listens_until_s = None

    def complete(self, fix: Fix) -> None:
        """Take the odometry of the fix that is handed over."""
        with self._lock:
            if self._carried is not None and self._carried.fix.stamp == fix.stamp:
                self._carried = CarriedFix(fix, self._senses, self._clock)

    def end(self) -> None:
        """Forget the fix: a new one is searched for."""
        with self._lock:
            self._carried = None

    def look(self, localizers: int | None) -> Due:
        """Messages that are due. Call it about ten times a second.

        Args:
            localizers: subscribers of the pose now; None if not known.
        """
        with self._lock:
            if self._carried is None or not self._config.repeat_s:
                return NOTHING
            came = localizers is not None and localizers > self._localizers
            self._localizers = localizers or 0
            now_s = self._clock()
            if not came and now_s < self._next_look_s:
                return NOTHING
            self._next_look_s = now_s + LOOK_S
            if self._stage is Stage.FOLLOWED:
                return self._look_after(self._carried, came)
            return self._look_on(self._carried, localizers, came)

    def _look_on(self, carried: CarriedFix, localizers: int | None, came: bool) -> Due:
        """Look on until the localizer follows."""
        now_s = self._clock()
        fix = carried.now()
        own = self._own(carried.fix.frame)
        expected = fix or carried.fix
        if own is not None and is_near(
            own.T_map_frame, expected.T_map_frame, self._config, planar=own.planar
        ):
            self._stage, self._listens_until_s = Stage.FOLLOWED, None
            return NOTHING
        if not carried.has_odometry and now_s - self._begin_s <= self._config.young_s:
            fix = carried.fix
        if fix is None:
            self._stage = Stage.OLD
            return Due(search=came)
        if came:
            self._came_s, self._is_awaited = now_s, True
        if localizers == 0:
            self._stage = Stage.WAITING
            return NOTHING
        is_new = now_s - self._came_s <= self._config.young_s and carried.way_m <= STANDS_M
        if not (own is not None or is_new or self._is_awaited):
            self._stage = Stage.PUBLISHED
            return NOTHING
        self._stage = Stage.REPEATED
        if now_s - self._sent_s < self._config.repeat_s:
            return NOTHING
        self._sent_s, self._is_awaited = now_s, False
        return Due(repeat=fix)

    def _look_after(self, carried: CarriedFix, came: bool) -> Due:
        """Looks, after the localizer has followed, whether another one has come in its place."""
        now_s = self._clock()
        if came and self._config.at_start:
            self._listens_until_s = now_s + LISTEN_S
            self._silent_at = self._senses.newest_stamp()
        if self._listens_until_s is None:
            return NOTHING
        is_new = self._senses.newest_stamp() != self._silent_at
        if is_new and self._own(carried.fix.frame) is not None:
            self._listens_until_s = None
        elif now_s >= self._listens_until_s:
            self._listens_until_s = None
            return Due(search=True)
        return NOTHING

    def _own(self, frame: str) -> OwnLocalization | None:
        """The robot's own localization by its newest messages; None if it is silent."""
        newest = self._senses.newest_stamp()
        return None if newest is None else self._senses.own_localization(frame, newest)

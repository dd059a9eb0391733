"""Gives a robot its wanted fix: an epoch, a place in memory, and a handover to its localizer."""

from __future__ import annotations

from collections.abc import Callable

from firstfix.answer.localization import Localization
from firstfix.ros.header import Header, Stamp
from firstfix.ros.pose_message import encode_pose

from .config import GatewayConfig
from .epoch import Epoch, next_number
from .fix_memory import FixMemory
from .given_fix import GivenFix
from .handover import Handover, Stage
from .query import Fix
from .senses import Senses
from .topics import Output, Publish, Subscribers
from .watch import is_near


class FirstFix:
    """The wanted fix of one robot.

    ``give`` and ``forget`` are called by the thread that asks, ``tick`` and ``complete`` by the one that
    ticks.

    Args:
        robot: its namespace.
        wall_ns: nanoseconds since 1970, for the epochs.
    """

    def __init__(
        self,
        robot: str,
        config: GatewayConfig,
        senses: Senses,
        publish: Publish,
        subscribers: Subscribers,
        log_line: Callable[[str], None],
        clock: Callable[[], float],
        wall_ns: Callable[[], int],
    ) -> None:
        self._robot, self._config, self._senses = robot, config, senses
        self._publish, self._subscribers, self._wall_ns = publish, subscribers, wall_ns
        self._memory = FixMemory(config.memory, robot, log_line)
        self._handover = Handover(config, senses, clock)
        self._epoch: Epoch | None = None
        self._pose_stamp: Stamp | None = None

    @property
    def epoch(self) -> Epoch | None:
        """Epoch of the fix; None before the first."""
        return self._epoch

    @property
    def pose_stamp(self) -> Stamp | None:
        """Stamp of the pose that was published last under this epoch; None if there was none."""
        return self._pose_stamp

    @property
    def stage(self) -> Stage | None:
        """How far the fix has come; None if there is none."""
        return self._handover.stage

    @property
    def listens(self) -> bool:
        """True while the robot's own localization and its odometry must be heard."""
        return self._handover.listens

    def give(self, fix: Fix, answer: Localization, *, asked: bool) -> None:
        """Publish a fix for the localizer. One that confirms the fix before is only handed over if need be.

        Args:
            asked: somebody called for a new search. Otherwise a fix that agrees with the one before, in the
                same map, keeps its epoch: the gateway was started again, and the robot was not.
        """
        before = self._memory.last
        if not asked and before is not None and self._continues(before, fix, answer):
            epoch, published = before.epoch, not self._config.repeat_s and not self._is_followed(fix)
        else:
            number = next_number(None if before is None else before.epoch.number, self._wall_ns())
            epoch, published = Epoch(self._robot, answer.map_version, number), True
        # First the memory: an epoch that somebody has seen is never given to another fix.
        self._memory.keep(GivenFix(epoch, answer.map_id, fix))
        self._epoch, self._pose_stamp = epoch, None
        localizers = self._subscribers(Output.INITIAL_POSE)
        if published:
            self._send(fix)
        self._handover.begin(fix, localizers, published=published)

    def complete(self, fix: Fix) -> None:
        """Take the last given fix again, now with its odometry."""
        self._handover.complete(fix)

    def forget(self) -> None:
        """End the handover: a new fix is searched for."""
        self._handover.end()

    def tick(self) -> bool:
        """Publish the pose again if it is due. Returns whether a new search is needed."""
        if self._handover.stage is None:
            return False
        due = self._handover.look(self._subscribers(Output.INITIAL_POSE))
        if due.repeat is not None:
            self._send(due.repeat)
        return due.search

    def _is_followed(self, fix: Fix) -> bool:
        """Whether the robot's own localization is heard, and agrees."""
        own = self._senses.own_localization(fix.frame, fix.stamp)
        return own is not None and is_near(own.T_map_frame, fix.T_map_frame, self._config, planar=own.planar)

    def _continues(self, before: GivenFix, fix: Fix, answer: Localization) -> bool:
        """Whether a fix confirms the one before, by the robot's localization or its odometry."""
        if before.map_id != answer.map_id or before.fix.frame != fix.frame:
            return False
        expected = before.carried_to(fix.T_odom_frame)
        if expected is not None and is_near(expected, fix.T_map_frame, self._config, planar=False):
            return True
        return self._is_followed(fix)

    def _send(self, fix: Fix) -> None:
        header = Header(fix.stamp, self._config.map_frame)
        self._pose_stamp = fix.stamp
        self._publish(Output.INITIAL_POSE, encode_pose(fix.T_map_frame, fix.covariance, header))

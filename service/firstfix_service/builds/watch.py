"""Whether a build has run for too long, in all or without any progress."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from firstfix.errors import BuildError, BuildStalled, BuildTimedOut


@dataclass(frozen=True)
class BuildLimits:
    """
    Attributes:
        timeout_s: that a build may run, all its attempts together.
        stall_s: that one attempt may run while its status stays the same.
    """

    timeout_s: float
    stall_s: float


class BuildWatch:
    """Watches one attempt from its start on.

    Args:
        before_s: for which earlier attempts have run.
        clock: seconds, monotonic.
    """

    def __init__(
        self, limits: BuildLimits, before_s: float, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._limits = limits
        self._before_s = before_s
        self._clock = clock
        self._started = self._moved = clock()
        self._stopped: float | None = None
        self._seen: object = None

    @property
    def ran_s(self) -> float:
        """For how long this attempt has run."""
        return (self._clock() if self._stopped is None else self._stopped) - self._started

    def stop(self) -> None:
        """The attempt has ended: from here on ``ran_s`` stays as it is."""
        self._stopped = self._clock()

    def see(self, status: Mapping[str, Any] | None) -> None:
        """Looks at the build's status.

        Args:
            status: None: it cannot be read now, which says nothing of the build: its time without progress
                begins anew.
        """
        seen = None if status is None else (status.get("stage"), status.get("progress"))
        if seen is None or seen != self._seen:
            self._seen = seen
            self._moved = self._clock()

    def overdue(self) -> BuildError | None:
        """The reason to end the build; None if there is none."""
        if self._before_s + self.ran_s > self._limits.timeout_s:
            return BuildTimedOut(f"the build ran for more than {self._limits.timeout_s:g} s")
        if self._clock() - self._moved > self._limits.stall_s:
            return BuildStalled(f"the build made no progress for {self._limits.stall_s:g} s")
        return None

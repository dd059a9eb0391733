"""Limits of a running build, and whether it is within them."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from firstfix.errors import (
    BuildError,
    BuildStalled,
    BuildTimedOut,
)

from ..settings import Settings


@dataclass(frozen=True)
class BuildLimits:
    """Time limits.

    Attributes:
        timeout_s: of all attempts of a build together.
        stall_s: of one attempt whose status does not change.
    """

    timeout_s: float
    stall_s: float


def build_limits(settings: Settings) -> BuildLimits:
    """The time limits of builds: of a day, two hours without progress."""
    return BuildLimits(settings.build_timeout_s, settings.build_timeout_s / 12)


class BuildWatch:
    """Watches the time of one attempt, from its start.

    Args:
        before_s: time that earlier attempts have run.
        clock: monotonic time in seconds.
    """

    def __init__(
        self, limits: BuildLimits, before_s: float, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._limits = limits
        self._before_s = before_s
        self._clock = clock
        self._started = self._progressed = clock()
        self._stopped: float | None = None
        self._seen: object = None

    @property
    def ran_s(self) -> float:
        """Time that this attempt has run."""
        return (self._clock() if self._stopped is None else self._stopped) - self._started

    def stop(self) -> None:
        """Stop the clock: the attempt has ended."""
        self._stopped = self._clock()

    def see(self, status: Mapping[str, Any] | None) -> None:
        """Record the status of the build.

        Args:
            status: None if it cannot be read now. The time without progress then starts again, because an
                unreadable status is not the build's fault.
        """
        seen = None if status is None else (status.get("stage"), status.get("progress"))
        if seen is None or seen != self._seen:
            self._seen = seen
            self._progressed = self._clock()

    def overdue(self) -> BuildError | None:
        """The error if a limit is exceeded."""
        if self._before_s + self.ran_s > self._limits.timeout_s:
            return BuildTimedOut(f"the build ran for more than {self._limits.timeout_s:g} s")
        if self._clock() - self._progressed > self._limits.stall_s:
            return BuildStalled(f"the build made no progress for {self._limits.stall_s:g} s")
        return None

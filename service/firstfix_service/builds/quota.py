"""Quota of builds for each caller: unfinished builds, and build minutes per day."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from datetime import datetime, timedelta, timezone

from firstfix.builds.callers import CallerUsage
from firstfix.errors import QuotaExceeded

from ..auth.authenticate import build_minutes_per_day
from ..settings import Settings
from ..thread_pools import READS

BUILDS_RETRY_S = 60.0
MAX_UNFINISHED = 50  # of one caller: more would only wait, and each is looked at when the next one comes


class BuildQuota:
    """Limits the builds of each caller. For use by one event loop.

    Replicas that accept builds of one caller at the same moment can exceed the quota by one build each.

    Args:
        max_unfinished: builds of one caller that wait or run; 0: no limit.
        max_minutes_per_day: time that one caller's builds have run since midnight (UTC), after which no other
            build is accepted; 0: no limit.
    """

    @classmethod
    def of(cls, settings: Settings, usage: CallerUsage) -> BuildQuota:
        """Returns the quota of the settings. By default there is none unless the service is exposed."""
        minutes = build_minutes_per_day(settings)
        return cls(usage, max_unfinished=MAX_UNFINISHED if minutes else 0, max_minutes_per_day=minutes)

    def __init__(self, usage: CallerUsage, *, max_unfinished: float, max_minutes_per_day: float) -> None:
        self._usage = usage
        self._max_unfinished = max_unfinished
        self._max_minutes_per_day = max_minutes_per_day
        self._submitting: dict[str, str] = {}  # builds that are not on record yet: id to owner

    @asynccontextmanager
    async def reserve(self, owner: str, build_id: str) -> AsyncIterator[None]:
        """Counts a build while it is being recorded; within the block it is put on record as the owner's.

        Raises:
            QuotaExceeded: the caller has used up the builds or the minutes.
            StoreError: the store failed.
        """
        self._submitting[build_id] = owner
        try:
            submitting = {name for name, whose in self._submitting.items() if whose == owner}
            await READS.run(self._check, owner, submitting)
            yield
        finally:
            del self._submitting[build_id]

    def _check(self, owner: str, submitting: set[str]) -> None:
        if self._max_unfinished and len(self._usage.unfinished(owner) | submitting) > self._max_unfinished:
            raise QuotaExceeded(
                f"{self._max_unfinished:g} builds of this caller wait or run: try again when one has ended",
                retry_after_s=BUILDS_RETRY_S,
            )
        if self._max_minutes_per_day and self._usage.minutes_today(owner) >= self._max_minutes_per_day:
            raise QuotaExceeded(
                f"builds of this caller have run for {self._max_minutes_per_day:g} minutes today (UTC)",
                retry_after_s=_until_midnight_s(),
            )


def _until_midnight_s() -> float:
    now = datetime.now(timezone.utc)
    tomorrow = (now + timedelta(days=1)).replace(hour=0, minute=0, second=0, microsecond=0)
    return (tomorrow - now).total_seconds()

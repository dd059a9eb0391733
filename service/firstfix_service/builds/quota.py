"""Quota of builds for each caller: unfinished builds, and build minutes per day."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from datetime import datetime, timedelta, timezone

from firstfix.builds.callers import CallerUsage
from firstfix.errors import QuotaExceeded

from ..limits.limits import Limits
from ..thread_pools import READS

BUILDS_RETRY_S = 60.0


class BuildQuota:
    """Limits the builds of each caller. For use by one event loop.

    Once its builds have run for so many minutes since midnight (UTC), no other one is accepted. Replicas that
    accept builds of one caller at the same moment can exceed the quota by one build each.
    """

    def __init__(self, usage: CallerUsage, limits: Limits) -> None:
        self._usage = usage
        self._max_unfinished = limits.max_builds_per_caller
        self._max_minutes_per_day = limits.build_minutes_per_day
        self._submitting: dict[str, str] = {}  # builds that are not on record yet: id to owner

    @asynccontextmanager
    async def reserve(self, owner: str, build_id: str) -> AsyncIterator[None]:
        """Count a build while it is being recorded; within the block it is put on record as the owner's.

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
                f"{self._max_unfinished} builds of this caller wait or run: try again when one has ended",
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

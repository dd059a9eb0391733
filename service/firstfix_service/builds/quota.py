"""Quota of builds: how many of one caller may wait and run, and for how long in a day."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from datetime import datetime, timedelta, timezone

from firstfix.builds.caller_usage import CallerUsage
from firstfix.errors import QuotaExceeded

from ..auth.authenticate import chosen_limit
from ..exposure import exposed_at
from ..lanes import READS
from ..settings import Settings

BUILDS_RETRY_S = 60.0
DEFAULT_BUILDS, DEFAULT_MINUTES_PER_DAY = 50.0, 1440.0  # of one caller, where strangers can be some


class BuildQuota:
    """For one event loop. Replicas that take one caller's builds at the same moment can let through one each.

    Args:
        max_unfinished: builds of one caller that wait or run; 0: any number.
        max_minutes_per_day: that one caller's builds may have run since midnight (UTC) when another is handed
            in; 0: any number.
    """

    @classmethod
    def of(cls, settings: Settings, usage: CallerUsage) -> BuildQuota:
        """As the settings say; where nobody else can be a caller there is none."""
        exposed = bool(exposed_at(settings))
        return cls(
            usage,
            max_unfinished=chosen_limit(settings.max_builds_per_caller, DEFAULT_BUILDS, exposed),
            max_minutes_per_day=chosen_limit(
                settings.build_minutes_per_day, DEFAULT_MINUTES_PER_DAY, exposed
            ),
        )

    def __init__(self, usage: CallerUsage, *, max_unfinished: float, max_minutes_per_day: float) -> None:
        self._usage = usage
        self._max_unfinished = max_unfinished
        self._max_minutes_per_day = max_minutes_per_day
        self._handed_in: dict[str, str] = {}  # builds that are not on record yet: id to owner

    @asynccontextmanager
    async def one(self, owner: str, build_id: str) -> AsyncIterator[None]:
        """Holds a place for a build until it is on record, which is entered as the owner's.

        Raises:
            QuotaExceeded: the caller has as many builds, or minutes, as one may have.
            StoreError: as the store.
        """
        self._handed_in[build_id] = owner
        try:
            coming = {name for name, whose in self._handed_in.items() if whose == owner}
            await READS.run(self._check, owner, coming)
            yield
        finally:
            del self._handed_in[build_id]

    def _check(self, owner: str, coming: set[str]) -> None:
        if self._max_unfinished and len(self._usage.unfinished(owner) | coming) > self._max_unfinished:
            raise QuotaExceeded(
                f"{self._max_unfinished:g} builds of this caller wait or run: try again when some have ended",
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

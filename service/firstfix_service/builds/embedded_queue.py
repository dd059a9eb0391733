"""Embedded build queue: the service runs one build at a time, at low priority. Owners take turns.

The queue is the store itself: a build is recorded before its caller gets an answer, and builds that have not
ended when the service starts are run again. Their stage cache keeps the finished stages. Several services
with this queue can share one store: each build is run by one of them at a time.
"""

from __future__ import annotations

import asyncio
import time
from contextlib import suppress
from pathlib import Path

import structlog

from firstfix.catalog.catalog import Catalog
from firstfix.errors import FirstfixError, UnreadableRecord

from ..telemetry.metrics import Metrics
from ..thread_pools import MAINTENANCE
from .fair_order import FairOrder
from .process import BuildCommand
from .runner import BuildRunner, Turn
from .unfinished import UnfinishedBuilds
from .watch import BuildLimits
from .work_folder import WorkFolder

_log = structlog.get_logger(__name__)


class EmbeddedBuildQueue:
    """A ``BuildQueue`` that runs the builds on record in this service. For use by one event loop."""

    def __init__(
        self,
        catalog: Catalog,
        metrics: Metrics,
        *,
        command: BuildCommand,
        work_dir: Path,
        lease_s: float,
        max_attempts: int,
        limits: BuildLimits,
        poll_interval_s: float = 5.0,
    ) -> None:
        self._catalog = catalog
        self._metrics = metrics
        self._command = command
        self._work_dir = work_dir
        self._lease_s = lease_s
        self._max_attempts = max_attempts
        self._limits = limits
        self._poll_interval_s = poll_interval_s
        self._unfinished = UnfinishedBuilds(catalog, metrics)
        self._order = FairOrder()
        self._not_before: dict[str, float] = {}  # of builds that were put back: ``time.monotonic``
        self._wake = asyncio.Event()
        self._runner: BuildRunner | None = None

    @property
    def running(self) -> str | None:
        """Id of the build that runs now."""
        return None if self._runner is None else self._runner.running

    async def submit(self, build_id: str) -> None:
        """Wakes the queue."""
        self._wake.set()

    async def run(self) -> None:
        """Runs builds until it is cancelled."""
        folder = await WorkFolder.wait_for(self._work_dir)
        self._runner = runner = BuildRunner(
            self._catalog,
            self._metrics,
            folder,
            self._command,
            lease_s=self._lease_s,
            max_attempts=self._max_attempts,
            limits=self._limits,
        )
        try:
            while True:
                self._wake.clear()
                pause = True
                try:
                    pause = not await self._run_one(runner)
                except FirstfixError as error:
                    _log.warning("the build queue cannot continue yet", code=error.code, error=str(error))
                except Exception:  # a defect at one build must not end the queue
                    _log.exception("the build queue failed")
                if pause:
                    with suppress(TimeoutError):
                        async with asyncio.timeout(self._poll_interval_s):
                            await self._wake.wait()
        finally:
            folder.release()

    async def _run_one(self, runner: BuildRunner) -> bool:
        """Runs the next build that nobody else runs. Returns False if there is none, or if it has to wait."""
        for build in self._order.sort(await MAINTENANCE.run(self._unfinished.find)):
            if time.monotonic() < self._not_before.get(build.build_id, 0.0):
                continue
            try:
                turn = await runner.run(build.build_id)
            except UnreadableRecord:  # skip a build whose record was damaged just now
                continue
            self._not_before.pop(build.build_id, None)
            if turn is Turn.PUT_BACK:
                self._not_before[build.build_id] = time.monotonic() + runner.pause_s(build.build_id)
            if turn is not Turn.TAKEN:
                self._order.had_turn(build.owner)
                return True
        return False

"""The embedded build queue: one build at a time, each in a process of its own, at low priority. Callers take
turns.

The queue is the store itself: a build is durable before its caller hears of it, and whatever has not
ended when the service starts is run again. The process picks up what it had done, by its stage cache.
Several services with this queue on one store share the builds: each build is one's at a time.
"""

from __future__ import annotations

import asyncio
from contextlib import suppress
from pathlib import Path

import structlog

from firstfix.catalog.catalog import Catalog
from firstfix.errors import FirstfixError, UnreadableRecord

from ..lanes import UPKEEP
from ..telemetry.metrics import Metrics
from .fair_order import FairOrder
from .process import BuildCommand
from .runner import BuildRunner, Turn
from .unfinished import UnfinishedBuilds
from .watch import BuildLimits
from .work_folder import WorkFolder

_log = structlog.get_logger(__name__)


class EmbeddedBuildQueue:
    """Runs the builds on record: a ``BuildQueue``. One event loop's."""

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
        self._wake = asyncio.Event()
        self._runner: BuildRunner | None = None

    @property
    def running(self) -> str | None:
        return None if self._runner is None else self._runner.running

    async def submit(self, build_id: str) -> None:
        self._wake.set()

    async def run(self) -> None:
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
                    _log.warning("the build queue cannot go on yet", code=error.code, error=str(error))
                except Exception:  # one odd build must not end the queue
                    _log.exception("the build queue stumbled")
                if pause:
                    with suppress(TimeoutError):
                        async with asyncio.timeout(self._poll_interval_s):
                            await self._wake.wait()
        finally:
            folder.release()

    async def _run_one(self, runner: BuildRunner) -> bool:
        """Runs the build that is next of those that nobody else runs. False when there is none, or it is to
        wait."""
        for build in self._order.of(await UPKEEP.run(self._unfinished.find)):
            try:
                turn = await runner.run(build.build_id)
            except UnreadableRecord:  # damaged just now: the others go on
                continue
            if turn is not Turn.HELD:
                self._order.served(build.owner)
                return turn is not Turn.PUT_BACK
        return False

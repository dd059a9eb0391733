"""Embedded build queue: the service runs one build at a time, at low priority. Owners take turns.

The queue is the store itself: a build is recorded before its caller gets an answer, and builds that have not
ended when the service starts are run again. Their stage cache keeps the finished stages. Several services
with this queue can share one store: each build is run by one of them at a time.
"""

from __future__ import annotations

import asyncio
import time
from collections import OrderedDict
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Protocol

import structlog

from firstfix.builds.attempts import has_open_attempt
from firstfix.builds.records import FINAL_STATES, new_status
from firstfix.catalog.catalog import Catalog
from firstfix.errors import FirstfixError, NotFound, UnreadableRecord
from firstfix.maintenance.build_end import end_build

from ..settings import Settings
from ..telemetry.metrics import Metrics
from ..thread_pools import MAINTENANCE
from .runner import BuildRunner, Turn
from .work_folder import WorkFolder


class BuildQueue(Protocol):
    """A queue that runs the builds on record, or hands them to build workers.

    A build is recorded in the store before it is submitted, and each queue also looks for recorded builds
    that have not ended. So a lost submission delays a build and never loses it.
    """

    @property
    def running(self) -> str | None:
        """Id of the build that this process runs now."""

    @property
    def waits_for(self) -> str | None:
        """Why no build begins, for its caller: no names of hosts or folders. None: they begin in turn."""

    async def submit(self, build_id: str) -> None:
        """Tell the queue that a new build is on record. Returns at once and raise nothing."""

    async def run(self) -> None:
        """Run until cancelled. A running build is then stopped, and its next runner resumes it."""


NOBODY_BUILDS = "this service runs no builds: one that does has to use the same store"


def waits_for(queue: BuildQueue | None, state: str) -> str | None:
    """Why a build in this state does not begin; None: it begins in its turn, or has begun."""
    if state != "queued":
        return None
    return NOBODY_BUILDS if queue is None else queue.waits_for


def cancel_build(catalog: Catalog, build_id: str) -> dict[str, Any]:
    """Request the end of a build, whichever queue has it, and return its status.

    The request is an object in the store. A runner first claims a build and then looks for a request; this
    function first makes the request and then looks for a runner. So one of them always sees the other. A
    build that nobody runs is ended here.

    Raises:
        NotFound: there is no such build.
        Conflict: the build has ended.
    """
    catalog.builds.request_cancel(build_id)
    status = catalog.builds.status(build_id)
    if status["state"] not in FINAL_STATES and not has_open_attempt(catalog.store, build_id):
        status = new_status(
            "cancelled",
            map_id=status["map_id"],
            stage=status["stage"],
            progress=status["progress"],
            provisional_version=status["provisional_version"],
        )
        end_build(catalog, build_id, status)
    return status


@dataclass(frozen=True)
class UnfinishedBuild:
    """A build that waits or runs.

    Attributes:
        owner: the caller who submitted it; empty if the record does not say.
    """

    build_id: str
    owner: str


class UnfinishedBuilds:
    """Finds unfinished builds. Not thread-safe.

    It remembers which builds have ended and who owns the others, because neither ever changes.
    """

    def __init__(self, catalog: Catalog, metrics: Metrics) -> None:
        self._catalog = catalog
        self._metrics = metrics
        self._ended: set[str] = set()
        self._known: dict[str, UnfinishedBuild] = {}

    def find(self) -> list[UnfinishedBuild]:
        """The unfinished builds, oldest first: build ids begin with the time."""
        found = []
        on_record = self._catalog.builds.ids()
        self._ended.intersection_update(on_record)
        for build_id in on_record:
            if build_id in self._ended:
                continue
            try:
                state = self._catalog.builds.status(build_id)["state"]
                if state in FINAL_STATES:
                    self._ended.add(build_id)
                    continue
                found.append(self._known.get(build_id) or self._read(build_id))
            except (
                NotFound,
                UnreadableRecord,
            ):  # without a request there is no build; a damaged one is skipped
                continue
        self._known = {build.build_id: build for build in found}
        self._metrics.builds_waiting.set(len(found))
        return found

    def _read(self, build_id: str) -> UnfinishedBuild:
        return UnfinishedBuild(build_id, str(self._catalog.builds.request(build_id).get("owner") or ""))


MAX_OWNERS = 10_000  # the owner whose turn is longest ago is forgotten first


class FairOrder:
    """Round-robin over owners; the oldest build of an owner comes first. For use by one event loop."""

    def __init__(self) -> None:
        self._served: OrderedDict[str, None] = OrderedDict()  # owners that had a turn, the latest one last

    def sort(self, builds: Sequence[UnfinishedBuild]) -> list[UnfinishedBuild]:
        """The first build of each owner, then the second build of each owner, and so on.

        Within such a round, owners without a turn yet come first, by the age of their builds, then the others
        by the time since their last turn.

        Args:
            builds: oldest first. Running builds count for the rounds of their owners.
        """
        last_turn = {owner: number for number, owner in enumerate(self._served)}
        rounds: dict[str, int] = {}
        ranked = []
        for age, build in enumerate(builds):
            owner_round = rounds[build.owner] = rounds.get(build.owner, -1) + 1
            ranked.append((owner_round, last_turn.get(build.owner, -1), age, build))
        return [build for *_, build in sorted(ranked, key=lambda item: item[:3])]

    def had_turn(self, owner: str) -> None:
        """Record that the owner had a turn now."""
        self._served[owner] = None
        self._served.move_to_end(owner)
        while len(self._served) > MAX_OWNERS:
            self._served.popitem(last=False)


_log = structlog.get_logger(__name__)


class EmbeddedBuildQueue:
    """A ``BuildQueue`` that runs the builds on record in this service. For use by one event loop."""

    def __init__(
        self, settings: Settings, catalog: Catalog, metrics: Metrics, poll_interval_s: float = 5.0
    ) -> None:
        self._settings = settings
        self._catalog = catalog
        self._metrics = metrics
        self._poll_interval_s = poll_interval_s
        self._unfinished = UnfinishedBuilds(catalog, metrics)
        self._order = FairOrder()
        self._not_before: dict[str, float] = {}  # of builds that were put back: ``time.monotonic``
        self._wake = asyncio.Event()
        self._runner: BuildRunner | None = None
        self.waits_for: str | None = None

    @property
    def running(self) -> str | None:
        """Id of the build that runs now."""
        return None if self._runner is None else self._runner.running

    async def submit(self, build_id: str) -> None:
        """Wake the queue."""
        self._wake.set()

    async def run(self) -> None:
        """Run builds until it is cancelled."""
        folder = await WorkFolder.wait_for(self._settings.work_dir, self._settings, self._wait_for)
        self._runner = runner = BuildRunner(self._catalog, self._metrics, folder, self._settings)
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
                    await runner.prepare()
                    with suppress(TimeoutError):
                        async with asyncio.timeout(self._poll_interval_s):
                            await self._wake.wait()
        finally:
            await runner.close()
            folder.release()

    def _wait_for(self, why: str | None) -> None:
        self.waits_for = why

    async def _run_one(self, runner: BuildRunner) -> bool:
        """Run the next build that nobody else runs. Returns False if there is none, or if it has to wait."""
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

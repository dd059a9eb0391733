"""Runs one attempt of a build: claims it, runs its process, and records its end."""

from __future__ import annotations

import asyncio
import math
import time
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from enum import Enum
from typing import Any

import structlog

from firstfix.builds.attempts import Attempt, AttemptEnd, BuildAttempts
from firstfix.builds.callers import CallerUsage
from firstfix.builds.options import ExitCode, reported_stages
from firstfix.builds.records import FINAL_STATES, BuildRecords, new_status
from firstfix.catalog.catalog import Catalog
from firstfix.errors import (
    BuildAttemptsExceeded,
    BuildFailed,
    FirstfixError,
    NotFound,
    NothingToPatch,
    OutOfSpace,
    StoreError,
)
from firstfix.maintenance.build_end import end_build

from ..settings import Settings
from ..telemetry.metrics import Metrics
from ..thread_pools import BUILDS
from .build_watch import BuildWatch, build_limits
from .process import STOP_GRACE_S, BuildProcess, build_options
from .ready_process import ReadyProcess
from .work_folder import WorkFolder

_log = structlog.get_logger(__name__)
MAX_ATTEMPTS = 3  # of a build that dies in the same stage each time: its machine may be at fault once
FINAL_RECORD_S = 5.0  # limit for the last write to the store when this process has to end
STORE_PAUSE_S = 2.0
# Before a build that was put back is run again. One without space is put back as often as there are pauses.
PAUSES_S = (5.0, 20.0, 60.0, 300.0, 600.0)
# Only these names become labels: a build worker of another release may report others.
STAGE_LABELS = frozenset(reported_stages())


class Turn(Enum):
    """Result of one turn of a build."""

    ENDED = "ended"  # the build is in a final state
    DIED = "died"  # its process was killed: run it again
    PUT_BACK = "put back"  # by its process: run it again after ``BuildRunner.pause_s``
    TAKEN = "taken"  # another runner has it


class BuildRunner:
    """Runs builds in one work folder, one at a time. For use by one event loop."""

    def __init__(
        self,
        catalog: Catalog,
        metrics: Metrics,
        folder: WorkFolder,
        settings: Settings,
    ) -> None:
        self._catalog = catalog
        self._metrics = metrics
        self._settings = settings
        self._options = replace(build_options(settings), work=folder.path)
        self._ready = ReadyProcess(settings, self._options)
        self._limits = limits = build_limits(settings)
        # Often enough for the shortest of these times.
        self._beat_s = min(settings.build_lease_s, limits.timeout_s, limits.stall_s) / 6
        self._usage = CallerUsage(catalog.builds)
        self._attempts = BuildAttempts(
            catalog.store,
            folder.claimant,
            lease_s=settings.build_lease_s,
            max_attempts=MAX_ATTEMPTS,
        )
        self._put_backs: Counter[str] = Counter()  # of each build, one after the other
        self.running: str | None = None
        self._watch = BuildWatch(self._limits, 0.0)  # of the build that was claimed last
        self._owner: str | None = None  # of the same build

    async def prepare(self) -> None:
        """Keep a process ready for the next build, if the settings ask for one."""
        await self._ready.prepare()

    async def close(self) -> None:
        """End the process that is kept ready."""
        await self._ready.close()

    async def run(self, build_id: str) -> Turn:
        """Run one turn. If it is cancelled, the build's process is stopped and the build is queued again.

        Raises:
            NotFound: there is no such build.
            StoreUnavailable, StoreError: the store failed before the build was claimed.
        """
        attempt = await self._claim_shielded(build_id)
        if not isinstance(attempt, Attempt):
            return attempt
        _log.info("build starts", build_id=build_id, attempt=attempt.number)
        self.running = build_id
        try:
            return await self._run_attempt(attempt)
        except asyncio.CancelledError:  # the service stops
            await self._put_back_soon(attempt)
            raise
        finally:
            self.running = None

    def pause_s(self, build_id: str) -> float:
        """Seconds from now until a build that was just put back is to be run again."""
        return PAUSES_S[min(self._put_backs[build_id], len(PAUSES_S)) - 1]

    async def _run_attempt(self, attempt: Attempt) -> Turn:
        try:
            process = await self._ready.take(attempt.build_id) or await BuildProcess.start(
                self._settings, replace(self._options, build_id=attempt.build_id)
            )
        except OSError as error:
            return await self._insist(
                self._close, attempt, BuildFailed(f"the build command cannot be run: {error.strerror}")
            )
        try:
            code = await self._supervise(process, attempt)
        except asyncio.CancelledError:
            await process.stop()
            raise
        finally:
            self._watch.stop()
        _log.info("build process ended", build_id=attempt.build_id, exit_code=code)
        if code is None:
            return Turn.TAKEN
        return await self._insist(self._record_end, attempt, process, code)

    async def _claim_shielded(self, build_id: str) -> Attempt | Turn:
        """Claim the build. If cancelled meanwhile, it ends the attempt, which would else count as lost."""
        claiming = asyncio.create_task(BUILDS.run(self._claim, build_id))
        try:
            return await asyncio.shield(claiming)
        except asyncio.CancelledError:
            with suppress(TimeoutError, FirstfixError):
                claimed = await asyncio.wait_for(claiming, FINAL_RECORD_S)
                if isinstance(claimed, Attempt):
                    await self._put_back_soon(claimed)
            raise

    def _claim(self, build_id: str) -> Attempt | Turn:
        """Claim the build for this runner, or return why it is not run."""
        status = self._catalog.builds.status(build_id)
        if status["state"] in FINAL_STATES:
            return Turn.ENDED
        self._owner = self._catalog.builds.request(build_id).get("owner")
        self._watch = BuildWatch(self._limits, self._attempts.ran_s(build_id))
        try:
            attempt = self._attempts.claim(build_id, status)
        except BuildAttemptsExceeded as error:
            self._end(build_id, status, "failed", error)
            return Turn.ENDED
        if attempt is None:
            return Turn.TAKEN
        status = self._catalog.builds.status(build_id)  # another runner may have ended it meanwhile
        if status["state"] not in FINAL_STATES and not self._catalog.builds.is_cancel_requested(build_id):
            return attempt
        if status["state"] not in FINAL_STATES:
            self._end(build_id, status, "cancelled")
        self._end_attempt(attempt, AttemptEnd.ENDED)
        return Turn.ENDED

    async def _supervise(self, process: BuildProcess, attempt: Attempt) -> int | None:
        """Wait for the process, and kill it if it must not continue.

        Returns its exit code; None if another runner has the build now.
        """
        kill_at = math.inf  # after a cancellation: the time (time.monotonic) when it must have ended
        while True:
            code = await process.wait(self._beat_s)
            if code is not None:
                return code
            try:
                if not await BUILDS.run(self._attempts.beat, attempt):
                    _log.warning("build was given to another build worker", build_id=attempt.build_id)
                    process.kill()
                    await process.stop()
                    return None
                if kill_at == math.inf and await BUILDS.run(
                    self._catalog.builds.is_cancel_requested, attempt.build_id
                ):
                    # The process sees the request itself. It is killed if it does not end.
                    kill_at = time.monotonic() + 3 * STOP_GRACE_S
                self._watch.see(await BUILDS.run(self._catalog.builds.status, attempt.build_id))
            except (StoreError, NotFound) as error:
                _log.warning(
                    "the lease of a build was not renewed", build_id=attempt.build_id, error=str(error)
                )
                self._watch.see(None)
            process.overdue = process.overdue or self._watch.overdue()
            if process.overdue is not None or time.monotonic() > kill_at:
                process.kill()

    async def _put_back_soon(self, attempt: Attempt) -> None:
        with suppress(TimeoutError, FirstfixError):
            await asyncio.wait_for(BUILDS.run(self._put_back, attempt), FINAL_RECORD_S)

    def _put_back(self, attempt: Attempt) -> None:
        """Queue the build again after a stop. The stop does not count as a failed attempt."""
        status = self._catalog.builds.status_or_queued(attempt.build_id)
        if status["state"] not in FINAL_STATES | {"queued"}:
            self._catalog.builds.set_status(attempt.build_id, {**status, "state": "queued"})
        self._end_attempt(attempt, AttemptEnd.STOPPED)

    def _record_end(self, attempt: Attempt, process: BuildProcess, code: int) -> Turn:
        """Record the end of a build whose process ended, unless the process recorded it."""
        with suppress(StoreError):  # for people: the end of the build is more important
            self._catalog.builds.set_log(attempt.build_id, process.end_of_log())
        status = self._catalog.builds.status_or_queued(attempt.build_id)
        if code == ExitCode.TRY_AGAIN:
            self._put_back(attempt)
            return self._pause(attempt, status["error"])
        if code == ExitCode.NO_SPACE:
            return self._wait_for_space(attempt, status, process.why(code))
        self._put_backs.pop(attempt.build_id, None)
        cancelled = self._catalog.builds.is_cancel_requested(attempt.build_id)
        is_killed_here = process.exceeded_memory or process.overdue is not None or cancelled
        if status["state"] not in FINAL_STATES and code < 0 and not is_killed_here:
            self._end_attempt(attempt, AttemptEnd.DIED, status=status, why=process.why(code))
            self._catalog.builds.set_status(attempt.build_id, {**status, "state": "queued"})
            return Turn.DIED
        turn = self._close(attempt, process.overdue or BuildFailed(process.why(code)))
        if status["state"] == "succeeded":
            process.remove_log()
        return turn

    def _wait_for_space(self, attempt: Attempt, status: dict[str, Any], why: str) -> Turn:
        """Queue a build again that met a full store or work folder; after several times it fails."""
        error = status["error"] or {"code": OutOfSpace.code, "detail": why}
        if self._attempts.times_without_space(attempt.build_id) >= len(PAUSES_S):
            return self._close(attempt, OutOfSpace(error["detail"]))
        if status["state"] not in FINAL_STATES:
            self._catalog.builds.set_status(attempt.build_id, {**status, "state": "queued", "error": error})
        self._end_attempt(attempt, AttemptEnd.NO_SPACE, status=status, why=error["detail"])
        return self._pause(attempt, error)

    def _pause(self, attempt: Attempt, error: dict[str, str] | None) -> Turn:
        self._put_backs[attempt.build_id] += 1
        _log.warning(
            "a build was put back",
            build_id=attempt.build_id,
            again_in_s=self.pause_s(attempt.build_id),
            **({} if error is None else error),
        )
        return Turn.PUT_BACK

    def _close(self, attempt: Attempt, error: FirstfixError) -> Turn:
        """Record the end of the build, if it is not on record yet."""
        build_id = attempt.build_id
        status = self._catalog.builds.status_or_queued(build_id)
        if status["state"] in FINAL_STATES:
            if status["state"] != "succeeded":  # its process may have published until it ended
                end_build(self._catalog, build_id, status)
            self._count(build_id, status)
        elif self._catalog.builds.is_cancel_requested(build_id):
            self._end(build_id, status, "cancelled")
        else:
            self._end(build_id, status, "failed", error)
        self._end_attempt(attempt, AttemptEnd.ENDED)
        return Turn.ENDED

    def _end_attempt(
        self, attempt: Attempt, how: AttemptEnd, *, status: dict[str, Any] | None = None, why: str = ""
    ) -> None:
        """Record the end of the attempt, and charge its time to the owner of the build."""
        ran_s = self._watch.ran_s
        self._attempts.end(attempt, how, status=status, why=why, ran_s=ran_s)
        if self._owner is None:
            return
        try:
            self._usage.charge(self._owner, attempt.build_id, attempt.number, ran_s)
        except StoreError as error:  # the end of the build is more important than its minutes
            _log.warning(
                "the minutes of a build were not counted", build_id=attempt.build_id, error=str(error)
            )

    def _end(
        self, build_id: str, status: dict[str, Any], state: str, error: FirstfixError | None = None
    ) -> None:
        ended = new_status(
            state,
            map_id=status["map_id"],
            stage=status["stage"],
            progress=status["progress"],
            error=None if error is None else {"code": error.code, "detail": str(error)},
            provisional_version=status["provisional_version"],
        )
        end_build(self._catalog, build_id, ended)
        self._put_backs.pop(build_id, None)
        self._count(build_id, ended)

    def _count(self, build_id: str, ended: Mapping[str, Any]) -> None:
        code = (ended.get("error") or {}).get("code")
        # a patch that finds nothing needs nobody: alerts look at builds that failed
        state = code if code == NothingToPatch.code else ended["state"]
        count_build(self._catalog.builds, self._metrics, build_id, state)
        _log.info("build ended", build_id=build_id, state=state)

    async def _insist(self, record: Callable[..., Turn], *arguments: Any) -> Turn:
        """Try until the store accepts the record: an end that is not on record counts as a lost attempt."""
        while True:
            try:
                return await BUILDS.run(record, *arguments)
            except StoreError as error:
                _log.warning("the store did not accept the end of a build", error=str(error))
                await asyncio.sleep(STORE_PAUSE_S)


def count_build(records: BuildRecords, metrics: Metrics, build_id: str, state: str) -> None:
    """Count a build that ended, and the times of its stages if its process recorded them."""
    metrics.builds.labels(state).inc()
    with suppress(FirstfixError, TypeError, ValueError, KeyError):  # missing times of one build do no harm
        for stage in records.stages(build_id):
            name = stage["stage"] if stage["stage"] in STAGE_LABELS else "other"
            cached = "yes" if stage["cached"] else "no"
            metrics.build_stage_seconds.labels(name, cached).observe(float(stage["seconds"]))

"""Runs one attempt of a build: claims it, runs its process, and records its end."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Callable
from contextlib import suppress
from enum import Enum
from typing import Any

import structlog

from firstfix.builds.attempts import Attempt, AttemptEnd, BuildAttempts
from firstfix.builds.caller_usage import CallerUsage
from firstfix.builds.records import FINAL_STATES, new_status
from firstfix.catalog.catalog import Catalog
from firstfix.errors import (
    BuildAttemptsExceeded,
    BuildError,
    BuildFailed,
    FirstfixError,
    NotFound,
    StoreError,
)

from ..lanes import BUILDS
from ..telemetry.metrics import Metrics
from .metrics import count_build
from .process import EXIT_TRY_AGAIN, STOP_GRACE_S, BuildCommand, BuildProcess
from .watch import BuildLimits, BuildWatch
from .work_folder import WorkFolder

_log = structlog.get_logger(__name__)
FINAL_RECORD_S = 5.0  # limit for the last write to the store when this process has to end
STORE_PAUSE_S = 2.0


class Turn(Enum):
    """Result of one turn of a build."""

    ENDED = "ended"  # the build is in a final state
    DIED = "died"  # its process was killed: run it again
    PUT_BACK = "put back"  # by its process: run it again later
    TAKEN = "taken"  # another runner has it


class BuildRunner:
    """Runs builds in one work folder, one at a time. For use by one event loop."""

    def __init__(
        self,
        catalog: Catalog,
        metrics: Metrics,
        folder: WorkFolder,
        command: BuildCommand,
        *,
        lease_s: float,
        max_attempts: int,
        limits: BuildLimits,
    ) -> None:
        self._catalog = catalog
        self._metrics = metrics
        self._folder = folder
        self._command = command
        self._limits = limits
        # Often enough for the shortest of these times.
        self._beat_s = min(lease_s, limits.timeout_s, limits.stall_s) / 6
        self._usage = CallerUsage(catalog)
        self._attempts = BuildAttempts(
            catalog.store, folder.claimant, lease_s=lease_s, max_attempts=max_attempts
        )
        self.running: str | None = None
        self._watch = BuildWatch(limits, 0.0)  # of the build that was claimed last
        self._owner: str | None = None  # of the same build

    async def run(self, build_id: str) -> Turn:
        """Runs one turn. If it is cancelled, the build's process is stopped and the build is queued again.

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

    async def _run_attempt(self, attempt: Attempt) -> Turn:
        try:
            process = await BuildProcess.start(self._command, attempt.build_id, self._folder.path)
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
        """Claims the build. If cancelled meanwhile, it ends the attempt, which would else count as lost."""
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
        """Claims the build for this runner, or returns why it is not run."""
        status = self._catalog.build_status(build_id)
        if status["state"] in FINAL_STATES:
            return Turn.ENDED
        self._owner = self._catalog.build_request(build_id).get("owner")
        self._watch = BuildWatch(self._limits, self._attempts.ran_s(build_id))
        try:
            attempt = self._attempts.claim(build_id, status["stage"])
        except BuildAttemptsExceeded as error:
            self._end(build_id, status, "failed", {"code": error.code, "detail": str(error)})
            return Turn.ENDED
        if attempt is None:
            return Turn.TAKEN
        status = self._catalog.build_status(build_id)  # another runner may have ended it meanwhile
        if status["state"] not in FINAL_STATES and not self._catalog.is_cancel_requested(build_id):
            return attempt
        if status["state"] not in FINAL_STATES:
            self._end(build_id, status, "cancelled")
        self._end_attempt(attempt, AttemptEnd.ENDED)
        return Turn.ENDED

    async def _supervise(self, process: BuildProcess, attempt: Attempt) -> int | None:
        """Waits for the process, and kills it if it must not continue.

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
                    self._catalog.is_cancel_requested, attempt.build_id
                ):
                    # The process sees the request itself. It is killed if it does not end.
                    kill_at = time.monotonic() + 3 * STOP_GRACE_S
                self._watch.see(await BUILDS.run(self._catalog.build_status, attempt.build_id))
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
        """Queues the build again after a stop. The stop does not count as a failed attempt."""
        status = self._catalog.status_or_queued(attempt.build_id)
        if status["state"] not in FINAL_STATES | {"queued"}:
            self._catalog.set_build_status(attempt.build_id, {**status, "state": "queued"})
        self._end_attempt(attempt, AttemptEnd.STOPPED)

    def _record_end(self, attempt: Attempt, process: BuildProcess, code: int) -> Turn:
        """Records the end of a build whose process ended, unless the process recorded it."""
        status = self._catalog.status_or_queued(attempt.build_id)
        if code == EXIT_TRY_AGAIN:
            self._put_back(attempt)
            return Turn.PUT_BACK
        cancelled = self._catalog.is_cancel_requested(attempt.build_id)
        is_killed_here = process.exceeded_memory or process.overdue is not None or cancelled
        if status["state"] not in FINAL_STATES and code < 0 and not is_killed_here:
            self._end_attempt(attempt, AttemptEnd.DIED, stage=status["stage"], why=process.why(code))
            self._catalog.set_build_status(attempt.build_id, {**status, "state": "queued"})
            return Turn.DIED
        turn = self._close(attempt, process.overdue or BuildFailed(process.why(code)))
        if status["state"] == "succeeded":
            process.remove_log()
        return turn

    def _close(self, attempt: Attempt, error: BuildError) -> Turn:
        """Records the end of the build, if it is not on record yet."""
        build_id = attempt.build_id
        status = self._catalog.status_or_queued(build_id)
        if status["state"] in FINAL_STATES:
            self._count(build_id, status["state"])
        elif self._catalog.is_cancel_requested(build_id):
            self._end(build_id, status, "cancelled")
        else:
            self._end(build_id, status, "failed", {"code": error.code, "detail": str(error)})
        self._end_attempt(attempt, AttemptEnd.ENDED)
        return Turn.ENDED

    def _end_attempt(self, attempt: Attempt, how: AttemptEnd, *, stage: str = "", why: str = "") -> None:
        """Records the end of the attempt, and charges its time to the owner of the build."""
        ran_s = self._watch.ran_s
        self._attempts.end(attempt, how, stage=stage, why=why, ran_s=ran_s)
        if self._owner is None:
            return
        try:
            self._usage.charge(self._owner, attempt.build_id, attempt.number, ran_s)
        except StoreError as error:  # the end of the build is more important than its minutes
            _log.warning(
                "the minutes of a build were not counted", build_id=attempt.build_id, error=str(error)
            )

    def _end(
        self, build_id: str, status: dict[str, Any], state: str, error: dict[str, str] | None = None
    ) -> None:
        ended = new_status(
            state,
            map_id=status["map_id"],
            stage=status["stage"],
            progress=status["progress"],
            error=error,
        )
        self._catalog.set_build_status(build_id, ended)
        self._count(build_id, state)

    def _count(self, build_id: str, state: str) -> None:
        count_build(self._catalog, self._metrics, build_id, state)
        _log.info("build ended", build_id=build_id, state=state)

    async def _insist(self, record: Callable[..., Turn], *arguments: Any) -> Turn:
        """Tries until the store accepts the record: an end that is not on record counts as a lost attempt."""
        while True:
            try:
                return await BUILDS.run(record, *arguments)
            except StoreError as error:
                _log.warning("the store did not accept the end of a build", error=str(error))
                await asyncio.sleep(STORE_PAUSE_S)

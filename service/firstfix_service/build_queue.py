"""The embedded build queue: one build at a time, each in a process of its own, at low priority.

The queue is the store itself: a build is durable before its caller hears of it, and whatever has not
ended when the service starts is run again. The worker picks up what it had done, by its stage cache.
One service with builds to a store; replicas beside it only record what they are asked for.
"""

from __future__ import annotations

import asyncio
import importlib.util
import os
import signal
import time
from asyncio.subprocess import Process
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

import structlog

from firstfix.build_records import FINAL_STATES, new_status
from firstfix.catalog import Catalog
from firstfix.errors import BuildFailed, FirstfixError, NotFound

from .build_metrics import count_build, last_words
from .metrics import Metrics

_log = structlog.get_logger(__name__)
EXIT_TRY_AGAIN = 75  # EX_TEMPFAIL: stopped, or the store is out of reach
STOP_GRACE_S = 10.0  # from asking a process to end until it is ended


def builder_is_installed() -> bool:
    """Whether this installation can build maps. Finds the mesh tool without importing it."""
    return all(importlib.util.find_spec(name) is not None for name in ("firstfix_builder", "open3d"))


class BuildQueue:
    """Runs the builds on record. One event loop's."""

    def __init__(
        self,
        catalog: Catalog,
        metrics: Metrics,
        *,
        store_url: str,
        command: Sequence[str],
        work_dir: Path,
        niceness: int,
        environment: Mapping[str, str] | None = None,
        poll_interval_s: float = 5.0,
    ) -> None:
        self._catalog = catalog
        self._metrics = metrics
        self._store_url = store_url
        self._command = tuple(command)
        self._work_dir = work_dir
        self._niceness = niceness
        self._environment = dict(environment or {})
        self._poll_interval_s = poll_interval_s
        self._ended: set[str] = set()
        self._wake = asyncio.Event()
        self.running: str | None = None
        self._kill_at: float | None = (
            None  # the running build was cancelled: time.monotonic when it must be over
        )

    def wake(self) -> None:
        """There is something new on record."""
        self._wake.set()

    def cancelled(self, build_id: str) -> None:
        """The worker sees the request by itself; one that does not end is ended."""
        if build_id == self.running and self._kill_at is None:
            self._kill_at = time.monotonic() + 3 * STOP_GRACE_S

    async def run(self) -> None:
        """Until it is cancelled; then the running build is stopped, to be resumed by the next start."""
        while True:
            self._wake.clear()
            pause = True
            try:
                waiting = await asyncio.to_thread(self._unfinished)
                if waiting:
                    pause = await self._run_build(waiting[0])
            except FirstfixError as error:
                _log.warning("the build queue cannot go on yet", code=error.code, error=str(error))
            except Exception:  # one odd build must not end the queue
                _log.exception("the build queue stumbled")
            if pause:
                with suppress(TimeoutError):
                    await asyncio.wait_for(self._wake.wait(), self._poll_interval_s)

    def _unfinished(self) -> list[str]:
        """Builds that have not ended, oldest first: their ids begin with the time."""
        found = []
        for build_id in self._catalog.build_ids():
            if build_id in self._ended:
                continue
            try:
                state = self._catalog.build_status(build_id)["state"]
            except NotFound:  # a folder without a request is no build
                continue
            if state in FINAL_STATES:
                self._ended.add(build_id)
            else:
                found.append(build_id)
        self._metrics.builds_waiting.set(len(found))
        return found

    async def _run_build(self, build_id: str) -> bool:
        """Runs one build to its end. True when the queue should pause before it goes on."""
        if await asyncio.to_thread(self._is_cancelled_before_start, build_id):
            return False
        self._work_dir.mkdir(parents=True, exist_ok=True)
        log_path = self._work_dir / f"{build_id}.log"
        arguments = ("--store", self._store_url, "--build", build_id, "--work", str(self._work_dir))
        _log.info("build starts", build_id=build_id)
        self.running, self._kill_at = build_id, None
        try:
            with log_path.open("ab") as log:
                try:
                    process = await asyncio.create_subprocess_exec(
                        *self._command,
                        *arguments,
                        stdin=asyncio.subprocess.DEVNULL,
                        stdout=log,
                        stderr=log,
                        env={**os.environ, **self._environment},
                        start_new_session=True,  # Ctrl-C is the service's, which then ends it in good order
                    )
                except OSError as error:
                    return await asyncio.to_thread(self._close, build_id, f"no worker: {error.strerror}")
            with suppress(OSError):  # gone already
                os.setpriority(os.PRIO_PROCESS, process.pid, self._niceness)
            code = await self._wait(process)
        finally:
            self.running = None
        _log.info("build process ended", build_id=build_id, exit_code=code)
        if code == EXIT_TRY_AGAIN:
            return True
        return await asyncio.to_thread(self._close, build_id, _why(code, log_path))

    async def _wait(self, process: Process) -> int:
        try:
            while True:
                with suppress(TimeoutError):
                    return await asyncio.wait_for(process.wait(), 1.0)
                if self._kill_at is not None and time.monotonic() > self._kill_at:
                    _signal_group(process, signal.SIGKILL)
        except asyncio.CancelledError:  # the service stops
            _signal_group(process, signal.SIGTERM)
            with suppress(TimeoutError):
                await asyncio.wait_for(process.wait(), STOP_GRACE_S)
            _signal_group(process, signal.SIGKILL)  # whatever it left behind as well
            await process.wait()
            raise

    def _is_cancelled_before_start(self, build_id: str) -> bool:
        if not self._catalog.is_cancel_requested(build_id):
            return False
        status = self._catalog.build_status(build_id)
        if status["state"] not in FINAL_STATES:
            self._catalog.set_build_status(build_id, new_status("cancelled", map_id=status["map_id"]))
        self._end(build_id, "cancelled")
        return True

    def _close(self, build_id: str, why: str) -> bool:
        """Says what became of a build whose process ended, if the process itself could not."""
        status = self._catalog.build_status(build_id)
        if status["state"] not in FINAL_STATES:
            cancelled = self._catalog.is_cancel_requested(build_id)
            status = new_status(
                "cancelled" if cancelled else "failed",
                map_id=status["map_id"],
                stage=status["stage"],
                progress=status["progress"],
                error=None if cancelled else {"code": BuildFailed.code, "detail": why},
            )
            self._catalog.set_build_status(build_id, status)
        self._end(build_id, status["state"])
        return False

    def _end(self, build_id: str, state: str) -> None:
        self._ended.add(build_id)
        count_build(self._catalog, self._metrics, build_id, state)
        _log.info("build ended", build_id=build_id, state=state)
        if state == "succeeded":
            (self._work_dir / f"{build_id}.log").unlink(missing_ok=True)


def _signal_group(process: Process, number: signal.Signals) -> None:
    """To the worker and what it started: it leads a group of its own."""
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, number)


def _why(code: int, log_path: Path) -> str:
    """For people: how a process ended that did not say it in its status."""
    if code < 0:
        hint = " (out of memory?)" if code == -signal.SIGKILL else ""
        return f"the build process was ended by {signal.Signals(-code).name}{hint}"
    words = last_words(log_path)
    return (
        f"the build process failed with exit code {code}"
        if words is None
        else f"the build process failed: {words}"
    )

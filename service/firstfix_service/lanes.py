"""The threads in which the service waits for the store and the disk: a lane of its own for each kind of work,
so that what takes long never stands before what has to be done now.

Nothing runs in the event loop's default executor, or in the framework's: who comes there first has it.
"""

from __future__ import annotations

import asyncio
import contextvars
import threading
from collections import Counter, deque
from collections.abc import Awaitable, Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial, wraps
from typing import Any, ParamSpec, TypeVar

from .telemetry.request_scope import current_request

P = ParamSpec("P")
T = TypeVar("T")


@dataclass(frozen=True)
class _Job:
    work: Callable[[], Any]
    result: Future[Any]

    def run(self) -> None:
        if not self.result.set_running_or_notify_cancel():
            return
        try:
            self.result.set_result(self.work())
        except BaseException as error:
            self.result.set_exception(error)


class Lane:
    """A few threads. Callers take turns, and one of them alone never has all of the threads. Thread-safe; of
    the whole process.

    Args:
        threads: at most; they are started as they are needed.
    """

    def __init__(self, name: str, threads: int) -> None:
        self.name = name
        self._executor = ThreadPoolExecutor(threads, thread_name_prefix=name)
        self._threads = threads
        self._lock = threading.Lock()
        self._waiting: dict[str, deque[_Job]] = {}  # by caller; whose turn is next comes first
        self._running: Counter[str] = Counter()

    async def run(self, work: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> T:
        """Runs work and returns its result. Work that has begun goes on when nobody waits for
        it any more."""
        request = current_request()
        caller = "" if request is None else str(request.fields.get("caller", ""))
        call = partial(contextvars.copy_context().run, work, *args, **kwargs)
        job = _Job(call, Future())
        with self._lock:
            self._waiting.setdefault(caller, deque()).append(job)
        self._start()
        result: T = await asyncio.wrap_future(job.result)
        return result

    def route(self, work: Callable[P, T]) -> Callable[P, Awaitable[T]]:
        """Makes a route of a function that waits for the store or the disk."""

        @wraps(work)
        async def in_lane(*args: P.args, **kwargs: P.kwargs) -> T:
            return await self.run(work, *args, **kwargs)

        return in_lane

    def _start(self) -> None:
        """Starts what may run now."""
        with self._lock:
            while self._running.total() < self._threads and (caller := self._next()) is not None:
                jobs = self._waiting.pop(caller)
                job = jobs.popleft()
                if jobs:
                    self._waiting[caller] = jobs  # behind the others
                self._running[caller] += 1
                self._executor.submit(self._work, caller, job)

    def _next(self) -> str | None:
        """The caller whose turn it is. Work of the service itself has no caller, and may have all threads."""
        most = max(1, self._threads - 1)
        return next((one for one in self._waiting if not one or self._running[one] < most), None)

    def _work(self, caller: str, job: _Job) -> None:
        job.run()
        with self._lock:
            self._running[caller] -= 1
            if not self._running[caller]:
                del self._running[caller]
        self._start()


START = Lane("start", 8)  # what is opened at the start and closed at the end
KEYS = Lane("keys", 2)  # API keys and the issuer's keys: what was revoked
AUTH = Lane("auth", 4)  # whether a caller may see what a request names
BUILDS = Lane("builds", 8)  # who has a build, and how it ended: its lease
READS = Lane("reads", 16)  # one small thing of the catalog
LISTS = Lane("lists", 4)  # much of the catalog: pages of it, pictures
CHANGES = Lane("changes", 4)  # which version answers, where a map lies
COPIES = Lane("copies", 4)  # map files: to the disk, to the store, their digests
UPKEEP = Lane("upkeep", 4)  # what was abandoned, stages, garbage, the queue's look at all builds

"""A few threads for one kind of blocking work, shared fairly among callers."""

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

from ..telemetry.request_scope import current_caller

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
    """A few threads. Callers take turns, and one caller never has all threads. Thread-safe.

    Args:
        threads: maximum number of threads; they are started when they are needed.
    """

    def __init__(self, name: str, threads: int) -> None:
        self.name = name
        self._executor = ThreadPoolExecutor(threads, thread_name_prefix=name)
        self._threads = threads
        self._lock = threading.Lock()
        self._waiting: dict[str, deque[_Job]] = {}  # by caller; the caller whose turn is next comes first
        self._running: Counter[str] = Counter()

    async def run(self, work: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> T:
        """Runs work in a thread and returns its result. Work that has begun is not cancelled."""
        result: T = await asyncio.wrap_future(self.submit(current_caller(), work, *args, **kwargs))
        return result

    def submit(self, caller: str, work: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Runs work in a thread, when it is the caller's turn.

        Args:
            caller: empty: the service itself.
        """
        call = partial(contextvars.copy_context().run, work, *args, **kwargs)
        job = _Job(call, Future())
        with self._lock:
            self._waiting.setdefault(caller, deque()).append(job)
        self._start_jobs()
        return job.result

    def close(self) -> None:
        """Waits for the work that has begun; the other work is cancelled."""
        with self._lock:
            waiting, self._waiting = self._waiting, {}
        for jobs in waiting.values():
            for job in jobs:
                job.result.cancel()
        self._executor.shutdown()

    def route(self, work: Callable[P, T]) -> Callable[P, Awaitable[T]]:
        """Makes a coroutine function for a route from a function that blocks."""

        @wraps(work)
        async def in_lane(*args: P.args, **kwargs: P.kwargs) -> T:
            return await self.run(work, *args, **kwargs)

        return in_lane

    def _start_jobs(self) -> None:
        with self._lock:
            while self._running.total() < self._threads and (caller := self._next_caller()) is not None:
                jobs = self._waiting.pop(caller)
                job = jobs.popleft()
                if jobs:
                    self._waiting[caller] = jobs  # behind the other callers
                self._running[caller] += 1
                self._executor.submit(self._work, caller, job)

    def _next_caller(self) -> str | None:
        """The caller whose turn it is. Work of the service itself has no caller and may use all threads."""
        limit = max(1, self._threads - 1)
        return next((one for one in self._waiting if not one or self._running[one] < limit), None)

    def _work(self, caller: str, job: _Job) -> None:
        job.run()
        with self._lock:
            self._running[caller] -= 1
            if not self._running[caller]:
                del self._running[caller]
        self._start_jobs()

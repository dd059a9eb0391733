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

from firstfix.errors import FirstfixError, Overloaded

from ..telemetry.request_scope import current_caller, current_request

P = ParamSpec("P")
T = TypeVar("T")


@dataclass(eq=False)
class _Job:
    work: Callable[[], Any]
    result: Future[Any]
    refusal: FirstfixError | None = None  # given to the request in place of the result

    def run(self) -> None:
        if not self.result.set_running_or_notify_cancel():
            return
        try:
            self.result.set_result(self.work())
        except BaseException as error:
            self.result.set_exception(error)


class ThreadPool:
    """A few threads. Callers take turns, and one caller never has all threads. Thread-safe.

    Args:
        threads: maximum number of threads; they are started when they are needed.
        turn_within_s: for which the work of a request waits for its turn; None: as long as it takes. Where
            the store hangs, the threads are free every 20 seconds only, and requests would queue up.
    """

    def __init__(self, name: str, threads: int, turn_within_s: float | None = None) -> None:
        self.name = name
        self._turn_within_s = turn_within_s
        self._asked: dict[asyncio.Future[Any], _Job] = {}  # by requests that wait now
        self._executor = ThreadPoolExecutor(threads, thread_name_prefix=name)
        self._threads = threads
        self._lock = threading.Lock()
        self._waiting: dict[str, deque[_Job]] = {}  # by caller; the caller whose turn is next comes first
        self._running: Counter[str] = Counter()

    async def run(self, work: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> T:
        """Run work in a thread and return its result. Work that has begun is not cancelled.

        Raises:
            Overloaded: a request asked, and its turn did not come in time, or ``give_up_requests``.
        """
        job = self._add(current_caller(), work, *args, **kwargs)
        result: asyncio.Future[T] = asyncio.wrap_future(job.result)
        return await (result if current_request() is None else self._asked_by_request(job, result))

    def submit(self, caller: str, work: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Run work in a thread, when it is the caller's turn.

        Args:
            caller: empty: the service itself.
        """
        return self._add(caller, work, *args, **kwargs).result

    def close(self) -> None:
        """Wait for the work that has begun; the other work is cancelled."""
        with self._lock:
            waiting, self._waiting = self._waiting, {}
        for jobs in waiting.values():
            for job in jobs:
                job.result.cancel()
        self._executor.shutdown()

    def give_up_requests(self, why: str) -> None:
        """End the waits of all requests of this event loop. Their work goes on where it has begun."""
        loop = asyncio.get_running_loop()
        for result, job in list(self._asked.items()):
            if result.get_loop() is loop and not result.done():
                job.refusal = Overloaded(why)
                result.cancel()

    def _add(self, caller: str, work: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> _Job:
        call = partial(contextvars.copy_context().run, work, *args, **kwargs)
        job = _Job(call, Future())
        with self._lock:
            self._waiting.setdefault(caller, deque()).append(job)
        self._start_jobs()
        return job

    async def _asked_by_request(self, job: _Job, result: asyncio.Future[T]) -> T:
        timer = None
        if self._turn_within_s is not None:
            loop = asyncio.get_running_loop()
            timer = loop.call_later(self._turn_within_s, self._refuse_if_waiting, job)
        self._asked[result] = job
        try:
            return await result
        except asyncio.CancelledError:
            task = asyncio.current_task()
            if job.refusal is None or (task is not None and task.cancelling()):
                raise
            raise job.refusal from None
        finally:
            del self._asked[result]
            if timer is not None:
                timer.cancel()

    def _refuse_if_waiting(self, job: _Job) -> None:
        if not job.result.running() and not job.result.done():
            job.refusal = Overloaded(f"too much work of the kind '{self.name}' waits: try again")
            job.result.cancel()  # unless it begins this moment

    def route(self, work: Callable[P, T]) -> Callable[P, Awaitable[T]]:
        """Make a coroutine function for a route from a function that blocks."""

        @wraps(work)
        async def in_pool(*args: P.args, **kwargs: P.kwargs) -> T:
            return await self.run(work, *args, **kwargs)

        return in_pool

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

"""Bounded work, shared out fairly: as many queries at a time as there are workers, a few waiting, the rest
told so at once.

The waiting ones stand in a queue for every map, and the maps take turns. A full queue still takes in a
query of a map that has few: the newest one of the map that has most goes out for it.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from typing import Any, Protocol, TypeVar

from firstfix.errors import DeadlineExceeded, FirstfixError, Overloaded

from ..lanes import START
from .fair_queue import FairQueue, Job, State

T = TypeVar("T")
MAX_RETRY_AFTER_S = 60.0


class Held(Protocol):
    """What a query needs while it waits for its turn and runs."""

    def close(self) -> None: ...


H = TypeVar("H", bound=Held)


class QueryPool:
    """Threads behind a fair, bounded queue. One event loop's, but for ``check_room`` and ``admitted``."""

    def __init__(self, workers: int, queue_size: int) -> None:
        self._executor = ThreadPoolExecutor(workers, thread_name_prefix="query")
        self._workers = workers
        self._limit = workers + queue_size
        self._queue = FairQueue(workers)
        self._closed = False

    @property
    def admitted(self) -> int:
        """Queries that wait or run."""
        return self._queue.size

    def check_room(self, group: str | None = None) -> None:
        """
        Args:
            group: as for ``run``; None: whichever.

        Raises:
            Overloaded: there would be no place for one more query now.
        """
        if self._closed:
            raise Overloaded("the service is stopping")
        if self._queue.size >= self._limit and self._queue.crowding(group) is None:
            raise self._full()

    async def run(
        self,
        group: str,
        prepare: Callable[[], Future[H]],
        work: Callable[[H, float], T],
        deadline: float | None = None,
    ) -> T:
        """The work's result. Who stops waiting for it gives up its place in the queue; a thread that has
        begun goes on, and its place stays taken until it ends: giving it up would let dead queries pile up
        behind it.

        Args:
            group: whose turn it takes: the map's id.
            prepare: called once there is a place. No worker waits for what it promises, which is closed
                when the query has ended, in whatever way.
            work: gets what was prepared, and the seconds that the query then waited for its turn.
            deadline: of ``time.monotonic``.

        Raises:
            Overloaded: the queue is full.
            DeadlineExceeded: there is no result at the deadline.
            Exception: what ``prepare`` or ``work`` raised.
        """
        loop = asyncio.get_running_loop()
        self.check_room(group)
        if self._queue.size >= self._limit and (crowding := self._queue.crowding(group)) is not None:
            self._refuse(crowding, self._full())
        job = Job(group, work, loop.create_future(), deadline)
        self._queue.add(job)
        try:
            prepared = prepare()
            if prepared.done():
                self._prepared(job, prepared)
            else:
                prepared.add_done_callback(partial(_in, loop, self._prepared, job))
            if deadline is not None:
                left_s = deadline - time.monotonic()
                job.timer = loop.call_later(max(0.0, left_s), self._refuse, job, _too_late())
            result: T = await job.result
            return result
        finally:
            if job.timer is not None:
                job.timer.cancel()
            self._leave(job)

    async def close(self) -> None:
        """Lets what runs end; what waits is refused."""
        self._closed = True
        for job in self._queue.waiting():
            self._refuse(job, Overloaded("the service is stopping"))
        await START.run(self._executor.shutdown)
        await asyncio.sleep(0)  # the last ones' results

    def _prepared(self, job: Job, future: Future[Any]) -> None:
        if job.state is State.GONE:
            if future.exception() is None:
                future.result().close()
            return
        error = future.exception()
        if error is not None:
            self._refuse(job, error)
            return
        job.held = future.result()
        self._queue.make_ready(job)
        self._dispatch()

    def _dispatch(self) -> None:
        loop = asyncio.get_running_loop()
        while (job := self._queue.next()) is not None:
            future = self._executor.submit(self._work, job)
            future.add_done_callback(partial(_in, loop, self._ended, job))

    @staticmethod
    def _work(job: Job) -> Any:
        start = time.monotonic()
        try:
            return job.work(job.held, start - job.ready_since)
        finally:
            job.seconds = time.monotonic() - start

    def _ended(self, job: Job, future: Future[Any]) -> None:
        self._queue.ended(job)
        job.held.close()
        error = future.exception()
        if not job.result.done():
            if error is not None:
                job.result.set_exception(error)
            elif job.deadline is not None and time.monotonic() > job.deadline:
                job.result.set_exception(_too_late())
            else:
                job.result.set_result(future.result())
        self._dispatch()

    def _refuse(self, job: Job, error: BaseException) -> None:
        if not job.result.done():
            job.result.set_exception(error)
        self._leave(job)

    def _leave(self, job: Job) -> None:
        """Takes a job that has not begun out of the queue."""
        if job.state in (State.PREPARING, State.READY):
            self._queue.remove(job)
            if job.held is not None:
                job.held.close()

    def _full(self) -> Overloaded:
        expected_s = self._queue.size * self._queue.mean_s / self._workers
        return Overloaded(
            f"{self._limit} queries wait or run: try again",
            retry_after_s=min(expected_s, MAX_RETRY_AFTER_S),
        )


def _in(loop: asyncio.AbstractEventLoop, call: Callable[..., None], *args: Any) -> None:
    with suppress(RuntimeError):  # the loop has ended with the service
        loop.call_soon_threadsafe(call, *args)


def _too_late() -> FirstfixError:
    return DeadlineExceeded("the answer would have come after deadline_ms")

"""A bounded, fair pool: one query at a time for each worker, a few more wait, the others are refused at once.

Callers take turns, and so do the maps of each caller (``fair_queue``). A full pool still accepts a query of a
caller that has few: it replaces the newest query of the caller that has most.
"""

from __future__ import annotations

import asyncio
import contextvars
import time
from collections.abc import Callable, Coroutine
from concurrent.futures import Future
from contextlib import suppress
from functools import partial
from typing import Any, Protocol, TypeVar

from firstfix.errors import DeadlineExceeded, FirstfixError, Overloaded

from .asker import Asker
from .fair_queue import FairQueue, Job, State

T = TypeVar("T")
MAX_RETRY_AFTER_S = 60.0


class Closeable(Protocol):
    """Resources of a query while it waits and runs."""

    def close(self) -> None:
        """Gives the resources back."""
        ...


C = TypeVar("C", bound=Closeable)


class QueryPool:
    """Tasks behind a fair, bounded queue. Belongs to one event loop; ``admitted`` is thread-safe."""

    def __init__(self, workers: int, queue_size: int) -> None:
        self._workers = workers
        self._limit = workers + queue_size
        self._queue = FairQueue(workers)
        self._closed = False
        self._running: set[asyncio.Task[Any]] = set()

    @property
    def admitted(self) -> int:
        """Number of queries that wait or run."""
        return self._queue.size

    def check_room(self, asker: Asker) -> None:
        """Checks that there is room for one more query now. ``run`` takes the room.

        Raises:
            Overloaded: the pool is full, or the service stops.
        """
        self._replaced_by(asker)

    async def run(
        self,
        asker: Asker,
        prepare: Callable[[], Future[C]],
        work: Callable[[C, float], Coroutine[Any, Any, T]],
        *,
        size_bytes: int = 0,
        deadline: float | None = None,
    ) -> T:
        """Returns the result of the work, once it is the query's turn.

        A cancelled call gives up its place in the queue. Work that has begun goes on and keeps its place
        until it ends; otherwise abandoned queries would pile up behind it.

        Args:
            asker: takes turns with the others.
            prepare: called once the query has a place. No worker waits for its future. The result is closed
                when the query has ended in any way.
            work: gets the prepared resources, and the seconds that the query then waited for its turn.
            size_bytes: of the query's body. A larger one should take longer.
            deadline: of ``time.monotonic``.

        Raises:
            Overloaded: the pool is full.
            DeadlineExceeded: there is no result at the deadline.
            Exception: any error of ``prepare`` or ``work``.
        """
        loop = asyncio.get_running_loop()
        if (replaced := self._replaced_by(asker)) is not None:
            self._refuse(replaced, self._full())
        job = Job(asker, work, loop.create_future(), deadline, size_bytes, contextvars.copy_context())
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
        """Refuses the queries that wait, and waits for the end of those that run."""
        self._closed = True
        for job in self._queue.waiting():
            self._refuse(job, Overloaded("the service is stopping"))
        if self._running:
            await asyncio.wait(self._running)
        await asyncio.sleep(0)  # delivers the last results

    def _prepared(self, job: Job, future: Future[Any]) -> None:
        if job.state is State.GONE:
            if future.exception() is None:
                future.result().close()
            return
        error = future.exception()
        if error is not None:
            self._refuse(job, error)
            return
        job.prepared = future.result()
        self._queue.make_ready(job)
        self._dispatch()

    def _dispatch(self) -> None:
        loop = asyncio.get_running_loop()
        while (job := self._queue.next()) is not None:
            job.began = time.monotonic()
            work = job.work(job.prepared, job.began - job.ready_since)
            task = loop.create_task(work, context=job.context)
            self._running.add(task)
            task.add_done_callback(partial(self._ended, job))

    def _ended(self, job: Job, task: asyncio.Task[Any]) -> None:
        self._running.discard(task)
        self._queue.ended(job, time.monotonic() - job.began)
        job.prepared.close()
        error = Overloaded("the service is stopping") if task.cancelled() else task.exception()
        if not job.result.done():
            if error is not None:
                job.result.set_exception(error)
            elif job.deadline is not None and time.monotonic() > job.deadline:
                job.result.set_exception(_too_late())
            else:
                job.result.set_result(task.result())
        self._dispatch()

    def _refuse(self, job: Job, error: BaseException) -> None:
        if not job.result.done():
            job.result.set_exception(error)
        self._leave(job)

    def _leave(self, job: Job) -> None:
        """Removes a query that has not begun."""
        if job.state in (State.PREPARING, State.READY):
            self._queue.remove(job)
            if job.prepared is not None:
                job.prepared.close()

    def _replaced_by(self, asker: Asker) -> Job | None:
        """The waiting query that a new one replaces; None while there is room for both.

        Raises:
            Overloaded: as ``check_room``.
        """
        if self._closed:
            raise Overloaded("the service is stopping")
        if self._queue.size < self._limit:
            return None
        replaced = self._queue.crowding(asker)
        if replaced is None:
            raise self._full()
        return replaced

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

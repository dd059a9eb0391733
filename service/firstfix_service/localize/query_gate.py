"""The gate to the workers: places, turns, free workers, and the bytes of bodies in memory.

One query at a time runs on each worker, a few more wait, the others are refused at once. Callers take turns,
and so do the maps of each caller (``fair_queue``). A full gate still accepts a query of a caller that has
few: it replaces the newest query of the caller that has most. A query waits nowhere else, so its deadline
ends each wait.
"""

from __future__ import annotations

import asyncio
import contextvars
import math
import time
from collections import deque
from collections.abc import Awaitable, Callable
from concurrent.futures import Future
from contextlib import suppress
from functools import partial
from typing import Any, Protocol, TypeVar

from firstfix.errors import DeadlineExceeded, FirstfixError, Overloaded, QueryCancelled, WorkerLost

from ..limits.asker import Asker
from ..limits.byte_budget import ByteBudget
from ..limits.fair_queue import FairQueue, Job, State
from ..limits.limits import Limits
from ..query_workers.base import QueryWorker, QueryWorkerDied
from ..query_workers.look import Answered, Asked

MAX_RETRY_AFTER_S = 60.0
UP_WITHIN_S = 30.0  # for any worker process to come up, before those that wait are refused
_WAITING = (State.PREPARING, State.READY)


class Closeable(Protocol):
    """Resources of a query while it waits and runs."""

    def close(self) -> None:
        """Give the resources back."""
        ...


C = TypeVar("C", bound=Closeable)


class QueryGate:
    """The way of all queries to the workers. Belongs to the event loop in which it is made.

    ``add_worker`` brings as many workers as the limits say.

    Attributes:
        bodies: the bodies in memory. Transports count them as they arrive.
    """

    def __init__(self, limits: Limits) -> None:
        self.bodies = ByteBudget.of_bodies(limits.max_inflight_bytes)
        self._loop = asyncio.get_running_loop()
        self._workers = limits.workers
        self._limit = limits.workers + limits.queue_size
        self._queue = FairQueue(limits.workers)
        self._closed = False
        self._running: set[asyncio.Future[Any]] = set()
        self._free: list[QueryWorker] = []  # the one that worked last comes first: its caches are warm
        # Of queries that run, and whose worker died
        self._waiting_for_new_worker: deque[asyncio.Future[QueryWorker]] = deque()
        self._giving_up: asyncio.TimerHandle | None = None

    def add_worker(self, worker: QueryWorker) -> None:
        """Add a worker that is up. Thread-safe."""
        _in(self._loop, self._worker_came, worker)

    @property
    def admitted(self) -> int:
        """Number of queries that wait or run. Thread-safe."""
        return self._queue.size

    def check_room(self, asker: Asker) -> None:
        """Check that there is room for one more query now. ``run`` takes the room.

        Raises:
            Overloaded: the pool is full, or the service stops.
        """
        if self._closed or self._queue.size >= self._limit:
            self._replaced_by(asker)

    async def run(
        self,
        asker: Asker,
        prepare: Callable[[], Future[C] | C],
        ask_for: Callable[[C, float], Asked],
        *,
        size_bytes: int = 0,
        deadline: float = math.inf,
        check: Callable[[], Awaitable[None]] | None = None,
        failed: Callable[[C, Exception], Awaitable[None]] | None = None,
    ) -> Answered:
        """The answer of a worker, once it is the query's turn and a worker is free.

        A cancelled call gives up its place in the queue, and so does a late one. What a worker has begun is
        cancelled there. It keeps its place until the worker is free; otherwise abandoned queries would pile
        up behind it.

        Args:
            asker: takes turns with the others.
            prepare: called once the query has a place; gives a result, or a future that no worker waits for.
                The result is closed when the query has ended in any way.
            ask_for: gets the prepared resources, and the seconds that the query then waited for its turn;
                returns what a worker is asked. If it dies, another one is asked the same.
            size_bytes: of the query's body. A larger one should take longer.
            deadline: of ``time.monotonic``; infinite: none.
            check: of the query, once it has a place.
            failed: looks at the error of a worker while the prepared resources are still held.

        Raises:
            Overloaded: the gate is full.
            DeadlineExceeded: there is no result at the deadline.
            WorkerLost: two workers died over the query, or none came up.
            Exception: any error of ``check``, ``prepare`` or the worker.
        """
        loop = self._loop
        is_full = self._closed or self._queue.size >= self._limit
        if is_full and (replaced := self._replaced_by(asker)) is not None:
            self._refuse(replaced, self._full())
        context = contextvars.copy_context()
        job = Job(asker, ask_for, loop.create_future(), deadline, size_bytes, context, failed=failed)
        self._queue.add(job)
        try:
            if deadline != math.inf:
                left_s = deadline - time.monotonic()
                job.timer = loop.call_later(max(0.0, left_s), self._refuse, job, _too_late())
            if check is not None:
                await check()
            if not job.result.done():
                prepared = prepare()
                if not isinstance(prepared, Future):
                    self._begin_to_wait(job, prepared)
                elif prepared.done():
                    self._prepared(job, prepared)
                else:
                    prepared.add_done_callback(partial(_in, loop, self._prepared, job))
            answer: Answered = await job.result
            return answer
        finally:
            if job.timer is not None:
                job.timer.cancel()
            if job.state in _WAITING:
                self._leave(job)
            elif job.answer is not None and not job.answer.done():  # late, or its caller has gone
                job.worker.cancel(job.answer)

    async def close(self) -> None:
        """Refuse the queries that wait, and wait for the end of those that run."""
        self._closed = True
        self._refuse_waiting(Overloaded("the service is stopping"))
        while self._running:
            await asyncio.wait(self._running)
            await asyncio.sleep(0)  # some may be asked again
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
        self._begin_to_wait(job, future.result())

    def _begin_to_wait(self, job: Job, prepared: Closeable) -> None:
        job.prepared = prepared
        self._queue.make_ready(job)
        self._dispatch()

    def _worker_came(self, worker: QueryWorker) -> None:
        self._free = [worker, *(one for one in self._free if one.is_alive)]  # it still warms up
        self._dispatch()

    def _dispatch(self) -> None:
        while self._free:
            worker = self._free.pop()
            if not worker.is_alive:
                continue
            if self._waiting_for_new_worker:
                waiting = self._waiting_for_new_worker.popleft()
                if not waiting.done():
                    waiting.set_result(worker)
                    continue
            job = self._queue.next()
            if job is None:
                self._free.append(worker)
                break
            self._begin(job, worker)
        if self._giving_up is not None or self._queue.ready or self._waiting_for_new_worker:
            self._expect_workers()

    def _begin(self, job: Job, worker: QueryWorker) -> None:
        job.began, job.worker = time.monotonic(), worker
        asked = job.ask_for(job.prepared, job.began - job.ready_since)
        answer = job.answer = job.context.run(worker.answer, asked)
        self._running.add(answer)
        answer.add_done_callback(partial(self._answered, job, asked))

    def _answered(self, job: Job, asked: Asked, answer: asyncio.Future[Answered]) -> None:
        if answer.cancelled() or (error := answer.exception()) is None or isinstance(error, QueryCancelled):
            self._ended(job, answer)
            return
        self._running.discard(answer)
        task = self._loop.create_task(self._failed(job, asked, error), context=job.context)
        self._running.add(task)
        task.add_done_callback(partial(self._ended, job))

    async def _failed(self, job: Job, asked: Asked, error: BaseException) -> Answered:
        """The answer of another worker if the first one died, else its error."""
        try:
            if not isinstance(error, QueryWorkerDied):
                raise error
            job.worker = None
            if job.result.done():  # too late, or its caller has gone
                raise _lost()
            job.worker = await self._another_worker()
            if job.result.done():
                raise _lost()
            job.answer = job.worker.answer(asked)
            try:
                return await job.answer
            except QueryWorkerDied:
                job.worker = None
                raise _lost() from None
        except Exception as error:
            if job.failed is not None:
                await job.failed(job.prepared, error)
            raise

    async def _another_worker(self) -> QueryWorker:
        waiting: asyncio.Future[QueryWorker] = self._loop.create_future()
        self._waiting_for_new_worker.append(waiting)
        self._dispatch()
        return await waiting

    def _expect_workers(self) -> None:
        """Give queries up that wait, if no worker answers one and none comes up in time."""
        is_any_up = self._free or len(self._running) > len(self._waiting_for_new_worker)
        if is_any_up or not (self._waiting_for_new_worker or self._queue.ready):
            if self._giving_up is not None:
                self._giving_up.cancel()
                self._giving_up = None
        elif self._giving_up is None:
            self._giving_up = self._loop.call_later(UP_WITHIN_S, self._give_up)

    def _give_up(self) -> None:
        self._giving_up = None
        self._refuse_waiting(WorkerLost("no worker process is up: try again"))

    def _refuse_waiting(self, error: FirstfixError) -> None:
        for job in self._queue.waiting():
            self._refuse(job, error)
        while self._waiting_for_new_worker:
            waiting = self._waiting_for_new_worker.popleft()
            if not waiting.done():
                waiting.set_exception(error)

    def _ended(self, job: Job, answer: asyncio.Future[Answered]) -> None:
        self._running.discard(answer)
        error = Overloaded("the service is stopping") if answer.cancelled() else answer.exception()
        self._queue.ended(job, time.monotonic() - job.began, is_whole=not isinstance(error, QueryCancelled))
        job.prepared.close()
        if job.worker is not None:
            self._free.append(job.worker)
        if not job.result.done():
            if error is not None:
                job.result.set_exception(error)
            elif time.monotonic() > job.deadline:
                job.result.set_exception(_too_late())
            else:
                job.result.set_result(answer.result())
        self._dispatch()

    def _refuse(self, job: Job, error: BaseException) -> None:
        if not job.result.done():
            job.result.set_exception(error)
        self._leave(job)

    def _leave(self, job: Job) -> None:
        """Remove a query that has not begun."""
        if job.state in _WAITING:
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


def _lost() -> WorkerLost:
    return WorkerLost("two worker processes died over the query")


def _too_late() -> FirstfixError:
    return DeadlineExceeded("the answer would have come after deadline_ms")

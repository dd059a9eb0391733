"""Bounded work: as many queries at a time as there are workers, a few waiting, the rest told so at once."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

from firstfix.errors import DeadlineExceeded, Overloaded

T = TypeVar("T")


class QueryPool:
    """Threads behind a bounded queue. Thread-safe."""

    def __init__(self, workers: int, queue_size: int) -> None:
        self._executor = ThreadPoolExecutor(workers, thread_name_prefix="query")
        self._limit = workers + queue_size
        self._admitted = 0
        self._lock = threading.Lock()

    @property
    def admitted(self) -> int:
        """Queries that wait or run."""
        return self._admitted

    def check_room(self) -> None:
        """
        Raises:
            Overloaded: there would be no place for one more query now.
        """
        if self._admitted >= self._limit:
            raise Overloaded(f"{self._limit} queries wait or run: try again")

    def submit(self, work: Callable[[], T], deadline: float | None = None) -> Future[T]:
        """Runs the work when a thread is free.

        Args:
            deadline: of ``time.monotonic``; work that has not begun by then is not begun.

        Raises:
            Overloaded: the queue is full.
        """
        with self._lock:
            self.check_room()
            self._admitted += 1

        def run() -> T:
            try:
                _check(deadline)
                result = work()
                _check(deadline)
                return result
            finally:
                with self._lock:
                    self._admitted -= 1

        try:
            return self._executor.submit(run)
        except RuntimeError:  # the service is stopping
            with self._lock:
                self._admitted -= 1
            raise Overloaded("the service is stopping") from None

    async def run(self, work: Callable[[], T], deadline: float | None = None) -> T:
        """The work's result.

        Raises:
            Overloaded: the queue is full.
            DeadlineExceeded: there is none at the deadline. A thread that has begun goes on, and its place
                stays taken until it ends: giving it up would let dead queries pile up behind it.
        """
        future = asyncio.wrap_future(self.submit(work, deadline))
        future.add_done_callback(_look_at)
        left_s = None if deadline is None else max(0.0, deadline - time.monotonic())
        try:
            return await asyncio.wait_for(asyncio.shield(future), left_s)
        except asyncio.TimeoutError:
            raise _too_late() from None

    def close(self) -> None:
        """Lets what runs end; what waits gets ``CancelledError``."""
        self._executor.shutdown(wait=True, cancel_futures=True)


def _check(deadline: float | None) -> None:
    if deadline is not None and time.monotonic() > deadline:
        raise _too_late()


def _too_late() -> DeadlineExceeded:
    return DeadlineExceeded("the answer would have come after deadline_ms")


def _look_at(future: asyncio.Future[T]) -> None:
    """Takes notice of an error that nobody waits for any more, or asyncio would complain of it."""
    if not future.cancelled():
        future.exception()

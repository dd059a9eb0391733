"""The workers that run no query."""

from __future__ import annotations

import asyncio
import threading
from collections import deque
from contextlib import suppress
from typing import Generic, TypeVar

W = TypeVar("W")


class IdleWorkers(Generic[W]):
    """Idle workers; the one that worked last comes first. Thread-safe; any event loop may wait for one."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._idle: list[W] = []
        self._waiting: deque[asyncio.Future[None]] = deque()

    def put(self, worker: W) -> None:
        """Adds a worker, and wakes all who wait for one."""
        with self._lock:
            self._idle.append(worker)
            waiting, self._waiting = self._waiting, deque()
        for one in waiting:
            with suppress(RuntimeError):  # its loop has ended
                one.get_loop().call_soon_threadsafe(_wake, one)

    async def take(self) -> W:
        """Returns an idle worker, as soon as there is one."""
        while True:
            with self._lock:
                if self._idle:
                    return self._idle.pop()
                woken = asyncio.get_running_loop().create_future()
                self._waiting.append(woken)
            await woken


def _wake(future: asyncio.Future[None]) -> None:
    if not future.done():
        future.set_result(None)

"""Tasks of the event loop that run in the background."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Coroutine
from contextlib import AsyncExitStack, suppress
from dataclasses import dataclass
from typing import Any

import structlog

from firstfix.errors import FirstfixError

from . import START

_log = structlog.get_logger(__name__)


@dataclass(frozen=True)
class PeriodicTask:
    """A task that runs again and again. A failure is logged and does not end it.

    Attributes:
        name: of the task, in the log.
        work: one run.
        interval_s: from the end of one run to the next run.
        first_after_s: from the start of the service to the first run.
    """

    name: str
    work: Callable[[], Awaitable[None]]
    interval_s: float
    first_after_s: float = 0.0

    async def run(self) -> None:
        """Run the task until it is cancelled."""
        await asyncio.sleep(self.first_after_s)
        while True:
            try:
                await self.work()
            except FirstfixError as error:
                _log.warning("a periodic task failed", task=self.name, code=error.code, error=str(error))
            except Exception:  # a defect must not end the task for good
                _log.exception("a periodic task failed", task=self.name)
            await asyncio.sleep(self.interval_s)

    def start(self, stack: AsyncExitStack) -> None:
        """Run the task until the stack is closed."""
        run_in_background(stack, self.run(), self.name)


def run_in_background(stack: AsyncExitStack, work: Coroutine[Any, Any, None], name: str) -> None:
    """Run a coroutine as a task until the stack is closed. Closing cancels it and wait for its end."""
    task = asyncio.create_task(work, name=name)

    async def stop() -> None:
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task

    stack.push_async_callback(stop)


def close_within(
    stack: AsyncExitStack,
    close: Callable[[], None],
    limit_s: float,
    name: str,
    run: Callable[[Callable[[], None]], Awaitable[None]] = START.run,
) -> None:
    """Let the stack call what blocks, and go on without its end after a time: the store or zenoh may hang.

    Args:
        run: runs the call in a thread.
    """

    async def stop() -> None:
        try:
            await asyncio.wait_for(run(close), limit_s)
        except TimeoutError:
            _log.warning("stops without the end of a part", part=name, limit_s=limit_s)

    stack.push_async_callback(stop)


def end_if_cancelled() -> None:
    """End the current task if it was cancelled and went on. Loops around calls of other libraries need it.

    Before Python 3.12, ``asyncio.wait_for`` drops a cancellation that comes together with its result.

    Raises:
        asyncio.CancelledError: the task was cancelled.
    """
    task = asyncio.current_task()
    if task is not None and task.cancelling():
        raise asyncio.CancelledError

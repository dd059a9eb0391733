"""Threads for calls of zenoh, any of which may hang: it waits for locks that a frozen peer can keep taken.

No such call runs on the event loop. These threads are daemons, so that none of them keeps the process from
ending, as the threads of an executor would.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from typing import ParamSpec, TypeVar

import structlog

P = ParamSpec("P")
T = TypeVar("T")
_log = structlog.get_logger(__name__)


async def in_zenoh_thread(work: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> T:
    """Runs work in a thread of its own and returns its result. Work that has begun is not cancelled."""
    done: Future[T] = Future()

    def run() -> None:
        try:
            result = work(*args, **kwargs)
        except BaseException as error:
            done.set_exception(error)
        else:
            done.set_result(result)

    done.set_running_or_notify_cancel()
    threading.Thread(target=run, name="zenoh-call", daemon=True).start()
    return await asyncio.wrap_future(done)


async def close_within(close: Callable[[], None], within_s: float) -> None:
    """Closes a part of zenoh, and leaves it behind if it takes longer: the service stops all the same."""
    with suppress(TimeoutError):
        async with asyncio.timeout(within_s):
            await in_zenoh_thread(close)
            return
    _log.error("a part of zenoh does not close: it is left behind", part=close.__qualname__)

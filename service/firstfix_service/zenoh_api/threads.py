"""Threads for calls of zenoh, any of which may hang: it waits for locks that a frozen peer can keep taken.

No such call runs on the event loop. These threads are daemons, so that none of them keeps the process from
ending, as the threads of an executor would.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


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

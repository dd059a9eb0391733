"""Waits for events. The limit is ten times what is usual: it ends a test that hangs, and judges no speed."""

from __future__ import annotations

import asyncio
import inspect
import time
from collections.abc import Callable

LIMIT_S = 240.0  # less than a test has: who waits in vain says for what
STEP_S = 0.02
# From one look to the next, in processor time of a look: who waits leaves the processor to others.
PAUSE, LONGEST_PAUSE_S = 4, 0.5


def wait_until(condition: Callable[[], object], limit_s: float = LIMIT_S, what: str = "") -> None:
    """Returns as soon as the condition holds; after ``limit_s`` the test fails and tells what is missing."""
    end, begin_s = time.monotonic() + limit_s, time.thread_time()
    while not condition():
        assert time.monotonic() < end, _in_vain(condition, limit_s, what)
        time.sleep(_pause_s(begin_s))
        begin_s = time.thread_time()


async def wait_until_async(condition: Callable[[], object], limit_s: float = LIMIT_S, what: str = "") -> None:
    """``wait_until`` for what goes on in the running event loop."""
    end, begin_s = time.monotonic() + limit_s, time.thread_time()
    while not condition():
        assert time.monotonic() < end, _in_vain(condition, limit_s, what)
        await asyncio.sleep(_pause_s(begin_s))
        begin_s = time.thread_time()


def let_pass(seconds: float) -> None:
    """Lets time pass: for what must not happen, and for clocks of the product that count real seconds.

    A test that calls it holds however late it returns. What must happen has ``wait_until``.
    """
    time.sleep(seconds)


def _pause_s(begin_s: float) -> float:
    """Returns the pause after a look that began at a time of this thread's processor clock."""
    return min(max(STEP_S, PAUSE * (time.thread_time() - begin_s)), LONGEST_PAUSE_S)


def _in_vain(condition: Callable[[], object], limit_s: float, what: str) -> str:
    if not what:
        try:
            what = inspect.getsource(condition).strip()
        except (OSError, TypeError):
            what = repr(condition)
    return f"waited {limit_s:g} s in vain for: {what}"

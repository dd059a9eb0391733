"""Waits for events. The limit is ten times what is usual: it ends a test that hangs, and judges no speed."""

from __future__ import annotations

import asyncio
import inspect
import time
from collections.abc import Callable

LIMIT_S = 240.0  # less than a test has: who waits in vain says for what
STEP_S = 0.02


def wait_until(condition: Callable[[], object], limit_s: float = LIMIT_S, what: str = "") -> None:
    """Returns as soon as the condition holds; after ``limit_s`` the test fails and tells what is missing."""
    end = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < end, _in_vain(condition, limit_s, what)
        time.sleep(STEP_S)


async def wait_until_async(condition: Callable[[], object], limit_s: float = LIMIT_S, what: str = "") -> None:
    """``wait_until`` for what goes on in the running event loop."""
    end = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < end, _in_vain(condition, limit_s, what)
        await asyncio.sleep(STEP_S)


def let_pass(seconds: float) -> None:
    """Lets time pass: for what must not happen, and for clocks of the product that count real seconds.

    A test that calls it holds however late it returns. What must happen has ``wait_until``.
    """
    time.sleep(seconds)


def _in_vain(condition: Callable[[], object], limit_s: float, what: str) -> str:
    if not what:
        try:
            what = inspect.getsource(condition).strip()
        except (OSError, TypeError):
            what = repr(condition)
    return f"waited {limit_s:g} s in vain for: {what}"

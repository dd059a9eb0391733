"""Long bodies, which may take hours but have to keep coming."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator
from dataclasses import dataclass

from fastapi import Request

from firstfix.errors import DeadlineExceeded


@dataclass(frozen=True)
class Pace:
    """Pace that a body has to keep. Only the time counts in which the sender is waited for.

    Attributes:
        stall_s: without a byte until it is given up; over each such time the mean rate is looked at.
        min_bytes_per_s: the lowest mean rate: one byte now and then is no progress.
        timeout_s: for all of it.
    """

    stall_s: float
    min_bytes_per_s: int
    timeout_s: float


async def paced_pieces(request: Request, pace: Pace) -> AsyncIterator[bytes]:
    """The pieces of a request's body, as they come.

    Raises:
        DeadlineExceeded: the body does not keep the pace.
        ClientDisconnect: the caller has gone.
    """
    stream = aiter(request.stream())
    waited_s = window_s = 0.0
    window_bytes = 0
    while True:
        asked = time.monotonic()
        try:
            async with asyncio.timeout(min(pace.stall_s, pace.timeout_s - waited_s)):
                piece = await anext(stream)
        except StopAsyncIteration:
            return
        except TimeoutError:
            raise _too_slow(pace, waited_s + pace.stall_s >= pace.timeout_s) from None
        took_s = time.monotonic() - asked
        waited_s += took_s
        window_s += took_s
        window_bytes += len(piece)
        if waited_s >= pace.timeout_s:
            raise _too_slow(pace, True)
        if window_s >= pace.stall_s:
            if window_bytes < pace.min_bytes_per_s * window_s:
                raise DeadlineExceeded(
                    f"the body comes with {window_bytes / window_s:.0f} bytes/s: at least "
                    f"{pace.min_bytes_per_s} are expected"
                )
            window_s, window_bytes = 0.0, 0
        yield piece


def _too_slow(pace: Pace, in_all: bool) -> DeadlineExceeded:
    if in_all:
        return DeadlineExceeded(f"the body did not arrive within {pace.timeout_s:g} s")
    return DeadlineExceeded(f"nothing of the body came for {pace.stall_s:g} s")

"""Long bodies, which may take hours but must keep a minimum pace."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator
from dataclasses import dataclass

from fastapi import Request

from firstfix.errors import DeadlineExceeded

MIN_BYTES_PER_S = 1024  # below it, nothing but an attack: the slowest radio links have more
TIMEOUT_S = 6 * 3600.0  # 20 GB at 1 MB/s; over a slower link a file comes in several requests


@dataclass(frozen=True)
class Pace:
    """Minimum pace of a body. Only the time in which the service waits for the sender counts.

    Attributes:
        stall_s: limit without a single byte. The mean rate is measured over windows of this length.
        min_bytes_per_s: lowest mean rate.
        timeout_s: limit of the whole body.
    """

    stall_s: float
    min_bytes_per_s: int = MIN_BYTES_PER_S
    timeout_s: float = TIMEOUT_S


async def paced_pieces(request: Request, pace: Pace) -> AsyncIterator[bytes]:
    """Yields the pieces of a request's body as they arrive.

    Raises:
        DeadlineExceeded: the body is too slow.
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
                    f"the body arrives with {window_bytes / window_s:.0f} bytes/s, the minimum is "
                    f"{pace.min_bytes_per_s}"
                )
            window_s, window_bytes = 0.0, 0
        yield piece


def _too_slow(pace: Pace, in_all: bool) -> DeadlineExceeded:
    if in_all:
        return DeadlineExceeded(f"the body did not arrive within {pace.timeout_s:g} s")
    return DeadlineExceeded(f"no byte of the body arrived for {pace.stall_s:g} s")

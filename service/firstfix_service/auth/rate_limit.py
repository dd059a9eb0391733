"""How often one caller may do something: a bucket of tokens each, refilled steadily."""

from __future__ import annotations

import time
from collections import OrderedDict
from collections.abc import Callable

from firstfix.errors import RateLimited

MAX_CALLERS = 10_000  # buckets kept; one that is forgotten was used least recently, and starts full again


class RateLimit:
    """One event loop's.

    Args:
        per_s: tokens that come back each second.
        burst: tokens of a full bucket, at least 1.
        clock: seconds, monotonic.
    """

    def __init__(
        self, what: str, per_s: float, burst: float, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._what = what
        self._per_s = per_s
        self._burst = max(1.0, burst)
        self._clock = clock
        self._buckets: OrderedDict[str, tuple[float, float]] = OrderedDict()  # name -> tokens, at this time

    def __len__(self) -> int:
        return len(self._buckets)

    def take(self, name: str) -> None:
        """
        Raises:
            RateLimited: the caller's bucket is empty.
        """
        now = self._clock()
        tokens, then = self._buckets.get(name, (self._burst, now))
        tokens = min(self._burst, tokens + (now - then) * self._per_s)
        if tokens < 1.0:
            wait_s = (1.0 - tokens) / self._per_s
            raise RateLimited(f"too many {self._what}: try again in {wait_s:.3g} s", wait_s)
        self._buckets[name] = (tokens - 1.0, now)
        self._buckets.move_to_end(name)
        if len(self._buckets) > MAX_CALLERS:
            self._buckets.popitem(last=False)

"""Limits on how often one caller may ask."""

from __future__ import annotations

import time
from collections import OrderedDict
from collections.abc import Callable

from firstfix.errors import RateLimited

MAX_CALLERS = 10_000  # buckets in memory; the least recently used one is dropped, and is full again later


class RateLimit:
    """A token bucket for each caller. For use by one event loop.

    Args:
        what: the counted requests, in the plural, for the error message.
        per_s: tokens that are added to each bucket per second.
        burst: tokens in a full bucket, at least 1.
        clock: monotonic time in seconds.
    """

    def __init__(
        self, what: str, per_s: float, burst: float, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._what = what
        self._per_s = per_s
        self._burst = max(1.0, burst)
        self._clock = clock
        self._buckets: OrderedDict[str, tuple[float, float]] = OrderedDict()  # tokens, time of that count

    def __len__(self) -> int:
        return len(self._buckets)

    def take(self, name: str) -> None:
        """Takes one token from the caller's bucket.

        Raises:
            RateLimited: the bucket is empty.
        """
        tokens = self._tokens(name)
        if tokens < 1.0:
            wait_s = (1.0 - tokens) / self._per_s
            raise RateLimited(f"too many {self._what}: try again in {wait_s:.3g} s", wait_s)
        self._keep(name, tokens - 1.0)

    def take_on_credit(self, name: str, at_most_s: float) -> float:
        """Takes one token from the caller's bucket, on credit if it is empty.

        Returns:
            seconds until the bucket is out of debt: callers who wait for so long keep to the rate. The debt
            does not grow beyond ``at_most_s``.
        """
        tokens = max(self._tokens(name) - 1.0, -at_most_s * self._per_s)
        self._keep(name, tokens)
        return max(0.0, -tokens / self._per_s)

    def give_back(self, name: str) -> None:
        """Gives one token back: what it was taken for is not done."""
        self._keep(name, min(self._burst, self._tokens(name) + 1.0))

    def _tokens(self, name: str) -> float:
        now = self._clock()
        tokens, then = self._buckets.get(name, (self._burst, now))
        return min(self._burst, tokens + (now - then) * self._per_s)

    def _keep(self, name: str, tokens: float) -> None:
        self._buckets[name] = (tokens, self._clock())
        self._buckets.move_to_end(name)
        if len(self._buckets) > MAX_CALLERS:
            self._buckets.popitem(last=False)

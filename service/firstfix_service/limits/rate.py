"""Limits on how often one caller may ask."""

from __future__ import annotations

import time
from collections import OrderedDict
from collections.abc import Callable

from firstfix.errors import RateLimited

from .limits import Limits


class Rate:
    """A token bucket for each caller. For use by one event loop.

    Args:
        what: the counted requests, in the plural, for the error message.
        per_s: tokens that are added to each bucket per second.
        burst: tokens in a full bucket, at least 1.
        max_wait_s: 0: a request over the rate is refused. Otherwise it takes its token on credit and waits
            until the bucket is out of debt, which does not grow beyond so long.
        clock: monotonic time in seconds.
    """

    def __init__(
        self,
        what: str,
        per_s: float,
        burst: float,
        *,
        max_wait_s: float = 0.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._what = what
        self._per_s = per_s
        self._burst = max(1.0, burst)
        self._max_wait_s = max_wait_s
        self._clock = clock
        self._buckets: OrderedDict[str, tuple[float, float]] = OrderedDict()  # tokens, time of that count

    def __len__(self) -> int:
        return len(self._buckets)

    def take(self, name: str) -> float:
        """Take one token from the caller's bucket.

        Returns:
            seconds for which the request waits: callers who do keep to the rate.

        Raises:
            RateLimited: the bucket is empty, and no request waits.
        """
        tokens = self._tokens(name) - 1.0
        if tokens < 0.0 and not self._max_wait_s:
            wait_s = -tokens / self._per_s
            raise RateLimited(f"too many {self._what}: try again in {wait_s:.3g} s", wait_s)
        tokens = max(tokens, -self._max_wait_s * self._per_s)
        self._keep(name, tokens)
        return max(0.0, -tokens / self._per_s)

    def give_back(self, name: str) -> None:
        """Give one token back: what it was taken for is not done."""
        self._keep(name, min(self._burst, self._tokens(name) + 1.0))

    def _tokens(self, name: str) -> float:
        now = self._clock()
        tokens, then = self._buckets.get(name, (self._burst, now))
        return min(self._burst, tokens + (now - then) * self._per_s)

    def _keep(self, name: str, tokens: float) -> None:
        self._buckets[name] = (tokens, self._clock())
        self._buckets.move_to_end(name)
        if len(self._buckets) > Limits.max_names:
            self._buckets.popitem(last=False)

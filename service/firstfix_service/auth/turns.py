"""Turns of all who ask, over HTTP and zenoh together: whoever asks too fast waits."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from .rate_limit import RateLimit

REQUESTS_PER_S = 50.0  # of one caller or one address: they then take a few percent of a core
BURST_S = 2.0  # a page, its files and what it shows come at once, for several people behind one address
MAX_WAIT_S = 5.0  # of a caller: as many connections as one address may have keep to the rate
MAX_STRANGER_WAIT_S = 2.0  # people who open the console may share their address with a stranger
MAX_PROBE_WAIT_S = 0.5  # probes give up after a second, and one may share its address with a stranger


@dataclass(frozen=True)
class Credit:
    """Requests that each of one kind of askers may make at once, and how long further ones wait.

    Attributes:
        limit: by name.
        max_wait_s: of one request.
    """

    limit: RateLimit
    max_wait_s: float

    def take(self, name: str) -> float:
        """Counts a request, and returns how long it has to wait, seconds."""
        return self.limit.take_on_credit(name, self.max_wait_s)

    def give_back(self, name: str) -> None:
        """Ends the count of a request for which nothing was done."""
        self.limit.give_back(name)


class Turns:
    """Credits of all who ask, for requests that no queue holds. For use by one event loop.

    Lists, files and refusals take about the same short time of the event loop that all share, so a refusal of
    those beyond a rate would save nothing: the next request would come at once. A request over its credit
    waits instead, and nothing fails. Callers are counted by name. Strangers, who have no caller, are counted
    by address: they ask for public files or for health, or their credential is missing or invalid.

    Args:
        clock: monotonic time in seconds.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._callers, self._strangers, self._probes = (
            RateLimit(what, REQUESTS_PER_S, BURST_S * REQUESTS_PER_S, clock)
            for what in ("requests", "requests of strangers", "probes")
        )

    def credit_of(self, caller: str, *, is_probe: bool = False) -> Credit:
        """Returns where a request counts.

        Args:
            caller: empty: a stranger.
            is_probe: a stranger asks for health.
        """
        if caller:
            return Credit(self._callers, MAX_WAIT_S)
        if is_probe:
            return Credit(self._probes, MAX_PROBE_WAIT_S)
        return Credit(self._strangers, MAX_STRANGER_WAIT_S)

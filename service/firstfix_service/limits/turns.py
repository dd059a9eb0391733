"""Turns of all who ask, over HTTP and zenoh together: whoever asks too fast waits."""

from __future__ import annotations

import time
from collections.abc import Callable

from .limits import Limits
from .rate import Rate


class Turns:
    """Rates of all who ask, for requests that no queue holds. For use by one event loop.

    Lists, files and refusals take about the same short time of the event loop that all share, so a refusal of
    those beyond a rate would save nothing: the next request would come at once. A request over its rate waits
    instead, and nothing fails. Callers are counted by name, the unauthenticated by address: they ask for
    public files or for health, or their credential is missing or invalid.

    Args:
        clock: monotonic time in seconds.
    """

    def __init__(self, limits: Limits, clock: Callable[[], float] = time.monotonic) -> None:
        per_s, burst = limits.requests_per_s, limits.request_burst_s * limits.requests_per_s
        self._callers, self._unauthenticated, self._probes = (
            Rate(what, per_s, burst, max_wait_s=max_wait_s, clock=clock)
            for what, max_wait_s in (
                ("requests", limits.max_wait_s),
                ("unauthenticated requests", limits.max_unauthenticated_wait_s),
                ("probes", limits.max_probe_wait_s),
            )
        )

    def rate_of(self, caller: str, *, is_probe: bool = False) -> Rate:
        """Key under which a request counts.

        Args:
            caller: empty: unauthenticated.
            is_probe: somebody unauthenticated asks for health.
        """
        return self._callers if caller else self._probes if is_probe else self._unauthenticated

"""The service's clock, as a robot knows it that may have a wrong one itself."""

from __future__ import annotations

import time


class ServiceClock:
    """This machine's clock, until the service has shown that it is wrong. Thread-safe."""

    def __init__(self) -> None:
        self._ahead_s: float | None = None  # of the monotonic clock, which nobody sets

    @property
    def now_ms(self) -> int:
        """Milliseconds since 1970 (UTC)."""
        now_s = time.time() if self._ahead_s is None else time.monotonic() + self._ahead_s
        return max(0, int(now_s * 1000))

    def follow(self, time_ms: int) -> None:
        """Takes over the service's time that has just arrived. It is never ahead: at most late by its way."""
        self._ahead_s = time_ms / 1000 - time.monotonic()

"""When to try again: bounded by attempts and by the caller's deadline, spread by jitter."""

from __future__ import annotations

import random
import time
from dataclasses import dataclass

from firstfix.errors import DeadlineExceeded

MAX_RETRY_AFTER_S = 3600.0


@dataclass(frozen=True)
class RetryPolicy:
    """
    Attributes:
        attempts: at most, the first one included; 1 turns retries off; None: as the time allows.
        first_wait_s: longest wait before all replicas are asked again; it doubles from there.
        max_wait_s: longest wait before any, unless the service asks for more.
        patience_s: no try begins later than this after a request's first: what has hours, as an upload has,
            does not wait so long for a service that is not there.
    """

    attempts: int | None = None
    first_wait_s: float = 0.1
    max_wait_s: float = 1.0
    patience_s: float = 60.0

    def wait_s(self, attempt: int, retry_after_s: float | None = None) -> float:
        """Seconds to wait after round number ``attempt`` (from 1) failed.

        Random over the whole interval ("full jitter"): a fleet that lost its service together must not
        come back together. What the service asked for is never undercut.
        """
        if retry_after_s is not None:
            return retry_after_s * random.uniform(1.0, 1.25)
        return random.uniform(0, min(self.max_wait_s, self.first_wait_s * 2 ** min(attempt - 1, 30)))


class Deadline:
    """A point in time that every attempt and every wait of one call shares."""

    def __init__(self, timeout_s: float) -> None:
        self._end_s = time.monotonic() + timeout_s
        self._timeout_s = timeout_s

    def remaining_s(self) -> float:
        """
        Raises:
            DeadlineExceeded: nothing is left.
        """
        left = self._end_s - time.monotonic()
        if left <= 0:
            raise self.exceeded()
        return left

    def allows(self, wait_s: float) -> bool:
        return time.monotonic() + wait_s < self._end_s

    def exceeded(self) -> DeadlineExceeded:
        return DeadlineExceeded(f"no answer within {self._timeout_s:g} s")


def retry_after_s(header: str | None) -> float | None:
    """Seconds of a Retry-After header; None for none, a date (no service of ours sends one) or nonsense."""
    try:
        seconds = float(header or "")
    except ValueError:
        return None
    return seconds if 0 <= seconds <= MAX_RETRY_AFTER_S else None

"""The deadline of a call."""

from __future__ import annotations

import time

from firstfix.errors import DeadlineExceeded


class Deadline:
    """A point in time that all tries and waits of one call share."""

    def __init__(self, timeout_s: float) -> None:
        self._end_s = time.monotonic() + timeout_s
        self._timeout_s = timeout_s

    def remaining_s(self) -> float:
        """Returns the seconds that are left.

        Raises:
            DeadlineExceeded: no time is left.
        """
        left = self._end_s - time.monotonic()
        if left <= 0:
            raise self.exceeded()
        return left

    def allows(self, wait_s: float) -> bool:
        """Returns whether time is left after such a wait."""
        return time.monotonic() + wait_s < self._end_s

    def exceeded(self) -> DeadlineExceeded:
        """Returns the error that says so."""
        return DeadlineExceeded(f"no answer within {self._timeout_s:g} s")

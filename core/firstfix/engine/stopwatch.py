"""Stopwatch for the stages of a query."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager


class Stopwatch:
    """Time of each stage, and the time left.

    Attributes:
        ms: milliseconds by stage, in the order in which stages began.
    """

    def __init__(self, within_ms: float | None = None) -> None:
        """Starts the watch.

        Args:
            within_ms: time from now that there is; None: any.
        """
        self.ms: dict[str, float] = {}
        self._end = math.inf if within_ms is None else time.perf_counter() + within_ms / 1e3

    @property
    def left_ms(self) -> float:
        """Milliseconds until the end; negative after it."""
        return (self._end - time.perf_counter()) * 1e3

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Adds the time of the block to a stage."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.ms[name] = self.ms.get(name, 0.0) + (time.perf_counter() - start) * 1e3

"""Time of a query's stages, and the time that is left."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager


class Stopwatch:
    """Time of each stage, and the time left.

    Attributes:
        deadline: of ``time.monotonic``; inf: none.
        ms: milliseconds by stage, in the order in which stages began.
    """

    def __init__(self, deadline: float = math.inf) -> None:
        self.deadline = deadline
        self.ms: dict[str, float] = {}

    @property
    def left_s(self) -> float:
        """Seconds until the deadline; negative after it."""
        return self.deadline - time.monotonic()

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Add the time of the block to a stage."""
        start = time.monotonic()
        try:
            yield
        finally:
            self.add(name, time.monotonic() - start)

    def add(self, name: str, seconds: float) -> None:
        """Add time that was measured elsewhere to a stage."""
        self.ms[name] = self.ms.get(name, 0.0) + seconds * 1e3

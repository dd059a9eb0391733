"""Counts that are made late, several together: code that has just run takes a third of the time."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterator
from typing import Any

from prometheus_client import CollectorRegistry
from prometheus_client.registry import Collector

TOGETHER = 32


class LateCounts(Collector):
    """Counts that wait. Whoever reads what is counted makes them first, as the metrics do. Thread-safe.

    Args:
        registry: reads its collectors in the order in which they came: this one comes before what is counted.
    """

    def __init__(self, registry: CollectorRegistry) -> None:
        self._waiting: deque[tuple[Callable[..., object], tuple[Any, ...]]] = deque()
        self._making = threading.Lock()
        registry.register(self)

    def add(self, count: Callable[..., object], *arguments: Any) -> None:
        """Let a count be made, now or later."""
        self._waiting.append((count, arguments))
        if len(self._waiting) >= TOGETHER:
            self.make()

    def make(self) -> None:
        """Make all counts that wait."""
        with self._making:  # in their order, and who reads waits for those that another thread makes
            while self._waiting:
                count, arguments = self._waiting.popleft()
                count(*arguments)

    def collect(self) -> Iterator[Any]:
        """Make the counts; there are no samples of this collector's own."""
        self.make()
        return iter(())

    def describe(self) -> Iterator[Any]:
        """Yield nothing."""
        return iter(())

"""Time of a query's stages, and the time that is left."""

from __future__ import annotations

import time
from collections.abc import Iterable

from .deadline import Deadline


class Stopwatch:
    """Time of each stage, and the time left.

    Attributes:
        deadline: of the query.
        ms: milliseconds by stage, in the order in which stages began.
    """

    def __init__(self, deadline: Deadline | None = None) -> None:
        self.deadline = deadline or Deadline()
        self.ms: dict[str, float] = {}

    def stage(self, name: str) -> _Stage:
        """Add the time of a ``with`` block to a stage.

        Raises:
            QueryCancelled: as ``Deadline.check_wanted``.
        """
        self.deadline.check_wanted()
        return _Stage(self.ms, name)

    def add(self, stages: Iterable[tuple[str, float]]) -> None:
        """Add seconds that were measured elsewhere to stages."""
        for name, seconds in stages:
            self.ms[name] = self.ms.get(name, 0.0) + seconds * 1e3


class _Stage:
    def __init__(self, ms: dict[str, float], name: str) -> None:
        self._ms, self._name = ms, name

    def __enter__(self) -> None:
        self._start = time.monotonic()

    def __exit__(self, *error: object) -> None:
        took_s = time.monotonic() - self._start
        self._ms[self._name] = self._ms.get(self._name, 0.0) + took_s * 1e3

"""Collector: sums up incoming sightings in a tally of limited size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .cells import Spot
from .sighting import Sighting
from .tally import Tally

MAX_ROWS = 1_000_000  # of a tally, 25 bytes each
MAX_SPOTS = 100_000
AGAIN_S = 300.0  # after this time a spot counts again
MAX_SUSPECTS = 200_000  # cells that were not explained at least once
_TOGETHER = 16  # tallies that are summed at a time


class Collector:
    """Sum of sightings of one map version since the last ``take``. Not thread-safe.

    A spot counts again only after AGAIN_S: a robot that stands still shows nothing new. A free cell is
    counted only after something in it was not explained: the other free cells are only air.
    """

    def __init__(self) -> None:
        self._parts: list[Tally] = []
        self._spots: dict[Spot, float] = {}  # time at which each counted
        self._suspects: NDArray[np.int64] = np.empty(0, np.int64)

    @property
    def is_full(self) -> bool:
        """True if no further sighting is counted before the next ``take``."""
        return sum(map(len, self._parts)) >= MAX_ROWS

    def knows(self, spot: Spot, now_s: float) -> bool:
        """Whether a sighting from this spot was counted lately."""
        return spot in self._spots and now_s < self._spots[spot] + AGAIN_S

    def add(self, sighting: Sighting, now_s: float = 0.0) -> None:
        """Count a sighting.

        Args:
            now_s: time by any clock, seconds.
        """
        if len(self._suspects) < MAX_SUSPECTS:
            self._suspects = np.union1d(self._suspects, sighting.unexplained)
        free = sighting.free[np.isin(sighting.free, self._suspects, assume_unique=True)]
        if len(self._spots) >= MAX_SPOTS:
            self._spots.clear()
        self._spots[sighting.spot] = now_s
        self._parts.append(Tally.of(replace(sighting, free=free)))
        if len(self._parts) >= _TOGETHER:
            self._parts = [Tally.sum(self._parts)]

    def take(self) -> Tally:
        """Everything that was counted since the last call."""
        taken, self._parts = Tally.sum(self._parts), []
        return taken

"""Order in which vehicles get a place for their scans: those that have failed to give one wait behind."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass

from .topics import VehicleName

Seek = tuple[VehicleName, int]  # a vehicle, and the number of its attempt


@dataclass(frozen=True)
class Wanted:
    """A scan that is wanted.

    Attributes:
        place: the topic, or the URL.
        left_s: time for which it is still waited for, once its turn has come.
        is_behind: the vehicle gave no scan when it was asked last.
    """

    seek: Seek
    place: str
    left_s: float
    is_behind: bool


class ScanQueue:
    """Scans that wait for a place. Those of vehicles that gave one, or were never asked, come first."""

    def __init__(self) -> None:
        self._first: OrderedDict[Seek, Wanted] = OrderedDict()
        self._behind: OrderedDict[Seek, Wanted] = OrderedDict()

    def add(self, wanted: Wanted) -> None:
        """Add a scan, as the last of its kind."""
        (self._behind if wanted.is_behind else self._first)[wanted.seek] = wanted

    def remove(self, seek: Seek) -> None:
        """Remove a scan, if it waits."""
        self._first.pop(seek, None)
        self._behind.pop(seek, None)

    def next(self) -> Wanted | None:
        """The scan whose turn it is; None: none waits."""
        queue = self._first or self._behind
        return next(iter(queue.values()), None)

    def clear(self) -> None:
        """Remove all."""
        self._first.clear()
        self._behind.clear()

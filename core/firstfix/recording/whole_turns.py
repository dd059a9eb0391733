"""Whole turns of a LiDAR: the first and the last of packets are cut where their capture begins and ends."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Generic, TypeVar

import numpy as np

from ..ros.point_cloud2 import StampedCloud

WHOLE = 0.9  # of the sectors of the turn beside it: a sector without a return moves with the sensor
_SECTORS = 120
_Turn = TypeVar("_Turn")


class WholeTurns(Generic[_Turn]):
    """Leaves out the first and the last of some turns where they are a part of one. A single one stays.

    Args:
        cloud_of: points of a turn.
    """

    def __init__(self, cloud_of: Callable[[_Turn], StampedCloud]) -> None:
        self._cloud_of = cloud_of
        self._held: tuple[_Turn, int] | None = None
        self._before = 0  # sectors of the turn before the held one; 0: the held one is the first

    def add(self, turn: _Turn) -> list[_Turn]:
        """Take a turn. Returns the one before it, if it is whole."""
        sectors, held = _sectors(self._cloud_of(turn)), self._held
        self._held = turn, sectors
        if held is None:
            return []
        is_first, self._before = not self._before, held[1]
        return [] if is_first and held[1] < WHOLE * sectors else [held[0]]

    def end(self) -> list[_Turn]:
        """The last turn, if it is whole."""
        held, self._held = self._held, None
        return [] if held is None or held[1] < WHOLE * self._before else [held[0]]


def whole_turns(turns: Iterable[StampedCloud]) -> Iterator[StampedCloud]:
    """Yield the whole ones of turns, see ``WholeTurns``."""
    whole: WholeTurns[StampedCloud] = WholeTurns(lambda turn: turn)
    for turn in turns:
        yield from whole.add(turn)
    yield from whole.end()


def _sectors(stamped: StampedCloud) -> int:
    """Number of directions around the sensor that have points; at least 1."""
    x, y = (stamped.cloud.columns[axis].astype(np.float64) for axis in "xy")
    seen = np.isfinite(x) & np.isfinite(y) & ((x != 0) | (y != 0))
    turn = np.arctan2(y[seen], x[seen]) / (2 * np.pi) % 1
    return max(1, len(np.unique((turn * _SECTORS).astype(np.int64) % _SECTORS)))

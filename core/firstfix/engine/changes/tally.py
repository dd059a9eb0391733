"""Tally: how often the cells of a map were confirmed, contradicted, not explained, free, or never mapped."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from .cells import SLOTS, slot_of
from .sighting import Sighting

KINDS = ("confirmed", "contradicted", "unexplained", "free", "unmapped")  # the last of the unexplained ones
UNEXPLAINED, UNMAPPED = KINDS.index("unexplained"), KINDS.index("unmapped")
_MAX_COUNT = np.iinfo(np.uint32).max


@dataclass(frozen=True)
class Tally:
    """Counts of sightings, by cell and by slot of the spot they were made from. Immutable.

    Sums of tallies can be made in any order, and the counts of one spot stay apart from those of others.

    Attributes:
        sightings: number of the sightings.
        cell: (n,) int64 keys of cells, ascending, and for each cell the slots ascending.
        slot: (n,) uint8.
        counts: (n, 5) uint32 sightings of each of KINDS; no row is all zero.
        coverage_known: number of the sightings whose map knew what its mapping run saw: only these tell what
            was never mapped from what is new.
    """

    sightings: int = 0
    cell: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    slot: NDArray[np.uint8] = field(default_factory=lambda: np.empty(0, np.uint8))
    counts: NDArray[np.uint32] = field(default_factory=lambda: np.empty((0, len(KINDS)), np.uint32))
    coverage_known: int = 0

    def __len__(self) -> int:
        return len(self.cell)

    @classmethod
    def of(cls, sighting: Sighting) -> Tally:
        """The tally of one sighting: each cell counts once, however many rays there were."""
        parts = [getattr(sighting, kind) for kind in KINDS]
        cell = np.concatenate(parts)
        kind = np.repeat(np.arange(len(KINDS)), [len(part) for part in parts])
        counts = (kind[:, None] == np.arange(len(KINDS))).astype(np.uint32)
        rows = _summed(cell, np.full(len(cell), slot_of(sighting.spot), np.uint8), counts)
        return cls(1, *rows, coverage_known=int(sighting.knows_coverage))

    @classmethod
    def sum(cls, parts: Iterable[Tally]) -> Tally:
        """The tally of all sightings of several tallies."""
        all_parts = [part for part in parts if part.sightings or len(part)]
        if len(all_parts) < 2:
            return all_parts[0] if all_parts else cls()
        rows = (np.concatenate([getattr(part, name) for part in all_parts]) for name in _ARRAYS)
        coverage_known = sum(part.coverage_known for part in all_parts)
        return cls(sum(part.sightings for part in all_parts), *_summed(*rows), coverage_known=coverage_known)

    def at(self, rows: NDArray[np.bool_]) -> Tally:
        """The chosen rows, with the number of all sightings."""
        return replace(self, cell=self.cell[rows], slot=self.slot[rows], counts=self.counts[rows])

    def check(self) -> None:
        """Check the form of a tally that was read.

        Raises:
            ValueError: it does not have the form of this class.
        """
        n = len(self.cell)
        if self.slot.shape != (n,) or self.counts.shape != (n, len(KINDS)) or self.sightings < 0:
            raise ValueError("the columns of a tally differ in length")
        if not 0 <= self.coverage_known <= self.sightings:
            raise ValueError("a tally tells more sightings apart than it has")
        if n and (int(self.slot.max()) >= SLOTS or not self.counts.any(axis=1).all()):
            raise ValueError("a row of a tally has a slot that does not exist, or no counts")
        if (self.counts[:, UNMAPPED] > self.counts[:, UNEXPLAINED]).any():
            raise ValueError("more sightings call a cell unmapped than did not explain it")
        if n and int(self.cell.min()) < 0:
            raise ValueError("a key of a tally is negative")
        order = self.cell[1:] > self.cell[:-1]
        order |= (self.cell[1:] == self.cell[:-1]) & (self.slot[1:] > self.slot[:-1])
        if not order.all():
            raise ValueError("the rows of a tally are out of order")


_ARRAYS = ("cell", "slot", "counts")


def _summed(
    cell: NDArray[np.int64], slot: NDArray[np.uint8], counts: NDArray[np.uint32]
) -> tuple[NDArray[np.int64], NDArray[np.uint8], NDArray[np.uint32]]:
    """Sums the rows of the same cell and slot, in order. Counts stop at the largest number."""
    if not len(cell):
        return cell, slot, counts
    order = np.lexsort((slot, cell))
    cell, slot = cell[order], slot[order]
    first = np.flatnonzero(np.r_[True, (cell[1:] != cell[:-1]) | (slot[1:] != slot[:-1])])
    total = np.add.reduceat(counts[order].astype(np.uint64), first, axis=0)
    return cell[first], slot[first], np.minimum(total, _MAX_COUNT).astype(np.uint32)

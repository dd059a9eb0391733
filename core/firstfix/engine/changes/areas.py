"""Areas of a map that have changed or were never mapped: what enough independent sightings agree on."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from ..false_accept_bound import upper_bound
from .cells import SLOTS, box_of, cells_of_keys
from .tally import UNEXPLAINED, UNMAPPED, Tally
from .unmapped import MIN_CELLS, groups_of, unmapped_of

MIN_SHARE = 0.3  # of the spots that see a cell: more of them say that it has changed
MIN_SPOTS = 4  # that have a vote about a cell
CONFIDENCE = 0.95  # of the vote about a cell
CONFIDENCE_BESIDE = 0.8  # of that about one beside a cell that has changed
ENOUGH_SPOTS = 16  # of the newest sightings of a cell: then the older ones do not matter
# For each kind of area, the columns of a tally's counts that speak for it and against it.
KINDS = {"gone": (1, 0), "new": (2, 3), "unmapped": (2, 3)}


@dataclass(frozen=True)
class CellVotes:
    """Votes about one kind of area, by cell. Each spot has one vote, which its sightings share.

    Attributes:
        cell: (n,) keys, ascending.
        spots: (n,) number of votes.
        share: (n,) 0..1, of the votes for a change.
        sightings: (n, 2) sightings for a change and against it.
    """

    cell: NDArray[np.int64]
    spots: NDArray[np.int64]
    share: NDArray[np.float64]
    sightings: NDArray[np.int64]

    @classmethod
    def of(cls, tally: Tally, kind: str) -> CellVotes:
        """Vote in a tally."""
        counts = tally.counts[:, list(KINDS[kind])].astype(np.int64)
        told = counts.any(axis=1)
        cell, row = np.unique(tally.cell[told], return_inverse=True)
        counts, n = counts[told], len(cell)
        share = np.bincount(row, counts[:, 0] / counts.sum(axis=1), n)
        spots = np.bincount(row, minlength=n)
        sightings = np.stack([np.bincount(row, counts[:, k], n) for k in (0, 1)], axis=1).astype(np.int64)
        return cls(cell, spots, share / np.maximum(spots, 1), sightings)

    def changed(self, min_share: float = MIN_SHARE) -> NDArray[np.bool_]:
        """(n,) for each cell whether, with CONFIDENCE, over ``min_share`` of the spots say so."""
        return (self.spots >= MIN_SPOTS) & (self._least_share(CONFIDENCE) > min_share)

    def changed_beside(self, changed: NDArray[np.bool_], min_share: float = MIN_SHARE) -> NDArray[np.bool_]:
        """(n,) which further cells, that touch one of (n,) these, have changed with CONFIDENCE_BESIDE.

        What moves is larger than a cell. There are fewer votes about its edges, which few rays meet, and
        beside which other things stand.
        """
        from scipy.spatial import cKDTree  # imported late: a replica starts without it

        beside = ~changed & (self._least_share(CONFIDENCE_BESIDE) > min_share)
        rows = np.flatnonzero(beside)
        tree = cKDTree(cells_of_keys(self.cell[changed]))
        away = tree.query(cells_of_keys(self.cell[rows]), p=np.inf, distance_upper_bound=1.5)[0]
        beside[rows] = np.isfinite(away)
        return beside

    def _least_share(self, confidence: float) -> NDArray[np.float64]:
        """(n,) least share of all spots that say so, with this confidence."""
        votes = np.minimum(np.floor(self.share * self.spots + 1e-9).astype(np.int64), self.spots)
        return _least_shares(confidence)[self.spots, votes]


@dataclass(frozen=True)
class Area:
    """A connected group of cells of one kind.

    Attributes:
        kind: ``gone``: mapped surfaces have left; ``new``: there is something that the map has not;
            ``unmapped``: so there is, and the mapping run never saw the place.
        cells: (n, 3) numbers of the cells: cell (i, j, k) begins at (i, j, k) times CELL_M, in the map's
            frame.
        share: (n,) 0..1, of the spots that see a cell and say so.
        spots: (n,) number of these spots, told apart up to SLOTS.
        sightings: (n, 2) sightings that say so, and that say otherwise.
    """

    kind: str
    cells: NDArray[np.int64]
    share: NDArray[np.float64]
    spots: NDArray[np.int64]
    sightings: NDArray[np.int64]

    @property
    def box_m(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lowest and highest corner, (3,) each, in the map's frame."""
        return box_of(self.cells)


def newest_first(tallies: Sequence[Tally]) -> Tally:
    """Sum of tallies of several days, in which each cell has only as many old sightings as it needs.

    Args:
        tallies: the newest first. Of an older one only the cells count that the newer ones together have seen
            from fewer than ENOUGH_SPOTS spots.
    """
    total = Tally()
    for tally in tallies:
        cell, spots = np.unique(total.cell, return_counts=True)
        told = cell[spots >= ENOUGH_SPOTS]
        total = Tally.sum([total, tally.at(~np.isin(tally.cell, told))])
    return total


def find_areas(tally: Tally, min_share: float = MIN_SHARE) -> list[Area]:
    """Areas of all kinds: those that have changed, then those that were never mapped, the largest first.

    Together, ``new`` and ``unmapped`` areas are what the map does not explain. Where no sighting knows what
    the mapping run saw, all of it is ``new``.
    """
    found: list[Area] = []
    for kind in ("gone", "new"):
        votes = CellVotes.of(tally, kind)
        changed = votes.changed(min_share)
        if not changed.any():
            continue
        rows = np.flatnonzero(changed | votes.changed_beside(changed, min_share))
        group = groups_of(cells_of_keys(votes.cell[rows]))
        for number in range(int(group.max()) + 1):
            part = rows[group == number]
            if changed[part].sum() >= MIN_CELLS:
                found += _areas_of_group(kind, votes, part, tally)
    return sorted(
        found, key=lambda area: (area.kind == "unmapped", -len(area.cells), area.kind, area.cells[0].tolist())
    )


def _areas_of_group(kind: str, votes: CellVotes, rows: NDArray[np.intp], tally: Tally) -> Iterator[Area]:
    """The areas of a connected group of cells: one of things that left, else of each kind the parts."""
    cells = cells_of_keys(votes.cell[rows])
    unmapped = np.zeros(len(rows), np.bool_)
    if kind == "new":
        unmapped = unmapped_of(cells, _unmapped_share(tally, votes.cell[rows]))
    for name, inside in ((kind, ~unmapped), ("unmapped", unmapped)):
        part = np.flatnonzero(inside)
        if not len(part):
            continue
        group = groups_of(cells[part])
        for number in range(int(group.max()) + 1):
            one = part[group == number]
            row = rows[one]
            yield Area(name, cells[one], votes.share[row], votes.spots[row], votes.sightings[row])


def _unmapped_share(tally: Tally, keys: NDArray[np.int64]) -> NDArray[np.float64]:
    """(n,) share of the spots that did not explain a cell and say that it was never seen.

    Args:
        keys: (n,) of unexplained cells, ascending.
    """
    rows = np.flatnonzero(np.isin(tally.cell, keys) & (tally.counts[:, UNEXPLAINED] > 0))
    place = np.searchsorted(keys, tally.cell[rows])
    votes = tally.counts[rows, UNMAPPED] / tally.counts[rows, UNEXPLAINED]
    return np.bincount(place, votes, len(keys)) / np.bincount(place, minlength=len(keys))


@cache
def _least_shares(confidence: float) -> NDArray[np.float64]:
    """(SLOTS + 1, SLOTS + 1) least share with this confidence, by numbers of votes and of votes for it."""
    least = np.zeros((SLOTS + 1, SLOTS + 1))
    for count in range(1, SLOTS + 1):
        for votes in range(1, count + 1):
            least[count, votes] = 1 - upper_bound(count - votes, count, confidence)
    return least

"""Areas of a map that have changed: what enough independent sightings agree on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ..false_accept_bound import upper_bound
from .cells import SLOTS, box_of, cells_of_keys
from .tally import Tally

MIN_SHARE = 0.3  # of the spots that see a cell: more of them say that it has changed
MIN_SPOTS = 4  # that have a vote about a cell
CONFIDENCE = 0.95  # of the vote about a cell
CONFIDENCE_BESIDE = 0.8  # of that about one beside a cell that has changed
FEWEST_CELLS = 3  # of an area, with full confidence: one cell may be an error of all poses on one side
ENOUGH_SPOTS = 16  # of the newest sightings of a cell: then the older ones do not matter
# For each kind of change, the columns of a tally's counts that speak for it and against it.
KINDS = {"gone": (1, 0), "new": (2, 3)}


@dataclass(frozen=True)
class CellVotes:
    """Votes about one kind of change, by cell. Each spot has one vote, which its sightings share.

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
        """Votes in a tally."""
        counts = tally.counts[:, list(KINDS[kind])].astype(np.int64)
        told = counts.any(axis=1)
        cell, row = np.unique(tally.cell[told], return_inverse=True)
        counts, n = counts[told], len(cell)
        share = np.bincount(row, counts[:, 0] / counts.sum(axis=1), n)
        spots = np.bincount(row, minlength=n)
        sightings = np.stack([np.bincount(row, counts[:, k], n) for k in (0, 1)], axis=1).astype(np.int64)
        return cls(cell, spots, share / np.maximum(spots, 1), sightings)

    def changed(self, min_share: float = MIN_SHARE) -> NDArray[np.bool_]:
        """Returns for each cell whether, with CONFIDENCE, over ``min_share`` of the spots say so."""
        return (self.spots >= MIN_SPOTS) & (self._least_share(CONFIDENCE) > min_share)

    def changed_beside(self, changed: NDArray[np.bool_], min_share: float = MIN_SHARE) -> NDArray[np.bool_]:
        """Returns which further cells, that touch one of these, have changed with CONFIDENCE_BESIDE.

        What moves is larger than a cell. There are fewer votes about its edges, which few rays meet, and
        beside which other things stand.
        """
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
    """A connected group of cells that have changed in the same way.

    Attributes:
        kind: ``gone``: mapped surfaces have left; ``new``: there is something that the map has not.
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
    """Areas that have changed, the largest first."""
    found = []
    for kind in KINDS:
        votes = CellVotes.of(tally, kind)
        changed = votes.changed(min_share)
        if not changed.any():
            continue
        rows = np.flatnonzero(changed | votes.changed_beside(changed, min_share))
        cells = cells_of_keys(votes.cell[rows])
        group = groups_of(cells)
        for number in range(int(group.max()) + 1):
            inside = group == number
            part = rows[inside]
            if changed[part].sum() >= FEWEST_CELLS:
                one = Area(kind, cells[inside], votes.share[part], votes.spots[part], votes.sightings[part])
                found.append(one)
    return sorted(found, key=lambda area: (-len(area.cells), area.kind, area.cells[0].tolist()))


def groups_of(cells: NDArray[np.int64]) -> NDArray[np.int32]:
    """(n,) number of the group of each of (n, 3) cells. Cells that touch, even at a corner, are together."""
    pairs = cKDTree(cells).query_pairs(1, p=np.inf, output_type="ndarray")
    links = coo_matrix((np.ones(len(pairs), bool), (pairs[:, 0], pairs[:, 1])), (len(cells), len(cells)))
    group: NDArray[np.int32] = connected_components(links, directed=False)[1]
    return group


@cache
def _least_shares(confidence: float) -> NDArray[np.float64]:
    """(SLOTS + 1, SLOTS + 1) least share with this confidence, by numbers of votes and of votes for it."""
    least = np.zeros((SLOTS + 1, SLOTS + 1))
    for count in range(1, SLOTS + 1):
        for votes in range(1, count + 1):
            least[count, votes] = 1 - upper_bound(count - votes, count, confidence)
    return least

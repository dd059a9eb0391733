"""Parts of unexplained cells: what stands in space that was seen free, and what was never mapped."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

MIN_CELLS = 3  # of an area: one cell may be an error of all poses on one side
UNMAPPED_SHARE = 0.5  # of those who did not explain a cell: more of them say that it was never seen


def groups_of(cells: NDArray[np.int64]) -> NDArray[np.int32]:
    """(n,) number of the group of each of (n, 3) cells. Cells that touch, even at a corner, are together."""
    from scipy.sparse import coo_matrix  # imported late: a replica starts without them
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    pairs = cKDTree(cells).query_pairs(1, p=np.inf, output_type="ndarray")
    links = coo_matrix((np.ones(len(pairs), bool), (pairs[:, 0], pairs[:, 1])), (len(cells), len(cells)))
    group: NDArray[np.int32] = connected_components(links, directed=False)[1]
    return group


def unmapped_of(cells: NDArray[np.int64], share: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(n,) which of (n, 3) unexplained cells were never mapped.

    A part of under MIN_CELLS takes the kind of the cells that it touches: few rays meet an edge.

    Args:
        share: (n,) 0..1, of those who did not explain a cell and say that it was never seen.
    """
    is_unmapped: NDArray[np.bool_] = share > UNMAPPED_SHARE
    if not is_unmapped.any():
        return is_unmapped
    whole = _sizes(cells)
    for kind in (True, False):
        rows = np.flatnonzero(is_unmapped == kind)
        if len(rows):
            size = _sizes(cells[rows])
            is_unmapped[rows[(size < MIN_CELLS) & (size < whole[rows])]] = not kind
    return is_unmapped


def _sizes(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """(n,) number of the cells that are together with each of (n, 3) cells."""
    group = groups_of(cells)
    sizes: NDArray[np.int64] = np.bincount(group)[group]
    return sizes

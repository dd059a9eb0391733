"""One place for each square block of the ground and each storey in it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

STOREY_GAP_M = 1.0


def one_per_block(
    xy_m: NDArray[np.float64], z: NDArray[np.float64], side_m: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The block of each of (n, 2) places at (n,) heights, and for each block the place nearest to its centre.

    Blocks are counted from the frame's origin. Places of one block whose heights leave no gap of
    STOREY_GAP_M are on one storey.

    Returns:
        (n,) block and storey of each place, and (blocks,) row of the place that stands for each.
    """
    block = np.floor(xy_m / side_m).astype(np.int64)
    order = np.lexsort((z, block[:, 1], block[:, 0]))
    new_block = np.any(np.diff(block[order], axis=0) != 0, axis=1)
    new_storey = np.diff(z[order]) > STOREY_GAP_M
    group = np.zeros(len(z), np.int64)
    group[order] = np.concatenate([[0], np.cumsum(new_block | new_storey)])
    off_centre = np.linalg.norm(xy_m - (block + 0.5) * side_m, axis=1).round(6)
    best = np.lexsort((z, xy_m[:, 1], xy_m[:, 0], off_centre, group))
    return group, best[np.concatenate([[True], np.diff(group[best]) != 0])]

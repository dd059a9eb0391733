"""Square tiles of a large map: points that lie near each other stand near each other in files."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def by_tiles(points: NDArray[np.floating], side_m: float) -> tuple[NDArray[np.intp], NDArray[np.int64]]:
    """Sorts (n, 3) points by tile. Within a tile they keep their order.

    Tiles are counted from the frame's origin, so a change of the map elsewhere does not change them.

    Returns:
        order: (n,) rows.
        start: (k + 1,) tile i holds ``order[start[i]:start[i + 1]]``. No tile is empty.
    """
    tile = np.floor(points[:, :2] / side_m).astype(np.int64)
    order = np.lexsort((tile[:, 1], tile[:, 0]))
    new = np.any(np.diff(tile[order], axis=0) != 0, axis=1)
    return order, np.concatenate([[0], np.flatnonzero(new) + 1, [len(points)]])


def by_nested_tiles(
    points: NDArray[np.floating], side_m: float, inner_m: float
) -> tuple[NDArray[np.intp], NDArray[np.int64]]:
    """Sorts like ``by_tiles``, and within each tile by smaller tiles. Returns the start of the smaller ones.

    Args:
        inner_m: edge of the smaller tiles: ``side_m`` divided by an integer.
    """
    inner, start = by_tiles(points, inner_m)
    first = inner[start[:-1]]
    outer = by_tiles(points[first], side_m)[0]
    counts = np.diff(start)[outer]
    order = np.concatenate([inner[start[i] : start[i + 1]] for i in outer])
    return order, np.concatenate([[0], np.cumsum(counts)])

"""The square tiles that a large map is worked in: what lies near together also stands together in files."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def by_tiles(points: NDArray[np.floating], side_m: float) -> tuple[NDArray[np.intp], NDArray[np.int64]]:
    """The order in which (n, 3) points stand tile by tile, within a tile as they stood before.

    Tiles are counted from the frame's origin, so that a change of the map elsewhere leaves them alone.

    Returns:
        order: (n,) rows.
        start: (k + 1,) tile i holds ``order[start[i]:start[i + 1]]``, and none of them is empty.
    """
    tile = np.floor(points[:, :2] / side_m).astype(np.int64)
    order = np.lexsort((tile[:, 1], tile[:, 0]))
    new = np.any(np.diff(tile[order], axis=0) != 0, axis=1)
    return order, np.concatenate([[0], np.flatnonzero(new) + 1, [len(points)]])


def by_nested_tiles(
    points: NDArray[np.floating], side_m: float, inner_m: float
) -> tuple[NDArray[np.intp], NDArray[np.int64]]:
    """``by_tiles``, with the points of each tile in smaller tiles, whose start is returned.

    Args:
        inner_m: edge of the smaller tiles, of which the larger ones hold a whole number.
    """
    inner, start = by_tiles(points, inner_m)
    first = inner[start[:-1]]
    outer = by_tiles(points[first], side_m)[0]
    counts = np.diff(start)[outer]
    order = np.concatenate([inner[start[i] : start[i + 1]] for i in outer])
    return order, np.concatenate([[0], np.cumsum(counts)])

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

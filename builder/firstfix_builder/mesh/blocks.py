"""The blocks that a large map is processed in: side by side, bounded in size, none of them empty."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Block:
    """A rectangle of the ground plane.

    Attributes:
        low, high: (2,) corners in metres; neighbours share a border.
    """

    low: NDArray[np.float64]
    high: NDArray[np.float64]

    def holds(self, points: NDArray[np.float64], margin_m: float = 0.0) -> NDArray[np.bool_]:
        """(n,) whether a point stands over the block or within the margin around it."""
        xy = points[:, :2]
        inside = (xy >= self.low - margin_m) & (xy < self.high + margin_m)
        return inside[:, 0] & inside[:, 1]


def occupied_blocks(points: NDArray[np.float64], max_side_m: float) -> list[Block]:
    """Blocks that hold a point, row by row; together they cover (n, 3) points.

    The side is the largest that fits the map evenly, so that no sliver is left at its end.
    """
    low = points[:, :2].min(axis=0) - 1.0
    size = points[:, :2].max(axis=0) + 1.0 - low
    number = np.ceil(size / max_side_m).astype(np.int64)
    side = size / number
    cell = np.clip(((points[:, :2] - low) / side).astype(np.int64), 0, number - 1)
    occupied = np.unique(cell, axis=0)
    return [Block(low + c * side, low + (c + 1) * side) for c in occupied]

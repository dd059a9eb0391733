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


def occupied_blocks(points: NDArray[np.float64], side_m: float) -> list[Block]:
    """Squares with corners at multiples of the side, those that hold a point of (n, 3), row by row.

    The grid does not depend on the points: what changes in one block leaves the others as they are.
    """
    column, row = np.floor(points[:, :2] / side_m).T
    occupied = np.unique(column + 1j * row)  # rows of an array would take eight times as long to sort
    corners = np.stack([occupied.real, occupied.imag], axis=1)
    return [Block(corner * side_m, (corner + 1) * side_m) for corner in corners]

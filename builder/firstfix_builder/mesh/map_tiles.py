"""Square tiles and blocks of the ground plane, by which a large map is processed part by part."""

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
    """Sort (n, 3) points like ``by_tiles``, and within each tile by smaller tiles.

    Returns (n,) rows in this order, and (tiles + 1,) starts of the smaller tiles in them.

    Args:
        inner_m: edge of the smaller tiles: ``side_m`` divided by an integer.
    """
    inner, start = by_tiles(points, inner_m)
    first = inner[start[:-1]]
    outer = by_tiles(points[first], side_m)[0]
    counts = np.diff(start)[outer]
    order = np.concatenate([inner[start[i] : start[i + 1]] for i in outer])
    return order, np.concatenate([[0], np.cumsum(counts)])

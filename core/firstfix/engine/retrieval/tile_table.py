"""Table of square ground tiles: where the rows of each tile begin and end in a sorted list."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

TILE_M = 5.0


def tile_table(
    points: NDArray[np.floating],
) -> tuple[NDArray[np.intp], NDArray[np.int32], NDArray[np.int32]]:
    """Sorts points by tile.

    Args:
        points: (n, 2 or more) metres.

    Returns:
        order: (n,) rows, tile after tile in columns along y, ascending in each.
        begin: (columns, rows + 1) int32, in tile (x, y) are ``order[begin[x, y]:begin[x, y + 1]]``.
        low: (2,) int32, x and y of the first tile, in tiles.
    """
    tile = np.floor(points[:, :2] / TILE_M).astype(np.int64)
    low = tile.min(axis=0)
    columns, rows = tile.max(axis=0) - low + 1
    number = (tile - low) @ [rows, 1]
    order = np.argsort(number, kind="stable")
    first = np.arange(columns)[:, None] * rows + np.arange(rows + 1)
    begin = np.searchsorted(number[order], first).astype(np.int32)
    return order, begin, low.astype(np.int32)


def runs_around(
    begin: NDArray[np.int32], low: NDArray[np.int32], centre: NDArray[np.floating], reach_m: float
) -> list[slice]:
    """Slices of the sorted list that hold the tiles within reach of a centre, one for each column.

    Args:
        begin: as ``tile_table`` returns it.
        low: as ``tile_table`` returns it.
        centre: (2 or more,) metres.
        reach_m: distance along x and y.
    """
    columns, ends = begin.shape
    bounds = []  # of the columns, then of the rows in each; of two numbers an array takes longer than the sum
    for at_m, lowest, size in zip(centre[:2].tolist(), low.tolist(), (columns, ends - 1), strict=True):
        first = math.floor((at_m - reach_m) / TILE_M) - lowest
        last = math.floor((at_m + reach_m) / TILE_M) - lowest + 1
        bounds.append([min(max(edge, 0), size) for edge in (first, last)])
    (left, right), rows = bounds
    return [slice(*run) for run in begin[left:right, rows].tolist()]

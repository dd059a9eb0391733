"""Rows of a map's points by square tiles of cells: what is made of a tile's points costs a tile's memory.

Tiles are counted from the frame's origin, so a change of the map elsewhere does not change them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise, product

import numpy as np
from numpy.typing import NDArray

TILE_M = 40.0


@dataclass(frozen=True)
class TileRows:
    """The points in one tile and in a border around it.

    Attributes:
        tile: its number in x and y.
        rows: (k,) ascending.
        own: (k,) which of them lie in the tile.
    """

    tile: tuple[int, int]
    rows: NDArray[np.int32]
    own: NDArray[np.bool_]


def cells_a_tile(cell_m: float) -> int:
    """Number of cells along the edge of a tile of about TILE_M."""
    return max(1, round(TILE_M / cell_m))


def columns_of(points: NDArray[np.floating], cell_m: float) -> NDArray[np.int64]:
    """(n, 2) number of the cell of each of (n, 2 or more) points in x and y."""
    return np.floor(points[:, :2].astype(np.float64) / cell_m).astype(np.int64)


def tile_rows(column: NDArray[np.int64], side: int, border: int = 0) -> Iterator[TileRows]:
    """Yield the tiles that have points in or around them, in the order of x and y.

    Args:
        column: (n, 2) cells of the points in x and y.
        side: cells along the edge of a tile.
        border: cells around a tile that count as its border, at most ``side``.
    """
    if not len(column):
        return
    tile = column // side
    low = tile.min(axis=0) - 1
    width = int(tile[:, 1].max() - low[1]) + 2
    number = (tile - low) @ [width, 1]
    within = column - tile * side
    near = {-1: within < border, 0: None, 1: within >= side - border}  # (n, 2) the tile before, the one after
    numbers, rows = [number], [np.arange(len(column), dtype=np.int32)]
    for x, y in product((-1, 0, 1), repeat=2):
        edges = [near[step][:, axis] for axis, step in enumerate((x, y)) if step]  # type: ignore[index]
        if edges and border:
            beside = np.flatnonzero(np.logical_and.reduce(edges)).astype(np.int32)
            numbers.append(number[beside] + x * width + y)
            rows.append(beside)
    of_tile, row = np.concatenate(numbers), np.concatenate(rows)
    order = np.argsort(of_tile, kind="stable")
    ends = np.flatnonzero(np.diff(of_tile[order], prepend=-1, append=-1))
    for first, last in pairwise(ends.tolist()):
        here = np.sort(row[order[first:last]])
        x, y = divmod(int(of_tile[order[first]]), width)
        yield TileRows((x + int(low[0]), y + int(low[1])), here, number[here] == of_tile[order[first]])

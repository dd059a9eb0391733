"""Sample of points that is even in space, whatever their order and density."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..mesh.places.chance import chance_of
from ..mesh.places.runs import rank_in_run


def rows_by_place(
    points: NDArray[np.floating], at_most: int, cell_m: float, seed: int = 0
) -> NDArray[np.int64]:
    """Rows, ascending, of points spread evenly over all places. Storeys count as places of their own.

    Space is cut into cubes. One random point is taken from each cube, then a second from each, and so on. In
    the last round chance decides which cubes are served.

    Args:
        points: (n, 3) metres.
        at_most: number of rows wanted; all rows if there are no more.
        cell_m: edge of a cube.
    """
    count = len(points)
    if count <= at_most:
        return np.arange(count)
    order = np.random.default_rng(seed).permutation(count)
    cells = np.unique(cells_of(points, cell_m)[order], axis=0, return_inverse=True)[1].reshape(-1)
    by_cell = np.argsort(cells, kind="stable")  # within a cell: in random order
    starts = np.flatnonzero(np.diff(cells[by_cell], prepend=-1))
    turn = np.empty(count, np.int64)  # of each point: how many of its cell come before it
    turn[by_cell] = np.arange(count) - np.repeat(starts, np.diff(starts, append=count))
    chosen = np.argsort(turn, kind="stable")[:at_most]  # within a turn too
    return np.sort(order[chosen])


def rows_by_hash(points: NDArray[np.floating], at_most: int, cell_m: float) -> NDArray[np.int64]:
    """Rows, ascending, as ``rows_by_place`` chooses them, but by a hash of each point's place.

    So a change elsewhere makes few others of them. To choose from parts of a map, and from what was chosen
    again, is to choose from all, where no cube is in two parts.
    """
    if len(points) <= at_most:
        return np.arange(len(points))
    cell = cells_of(points, cell_m)
    chance = chance_of(points, seed=0)
    by_cell = np.lexsort((chance, *cell.T[::-1]))  # within a cell: by chance
    turn = np.empty(len(points), np.int64)  # of each point: how many of its cell come before it
    turn[by_cell] = rank_in_run(cell[by_cell])
    return np.sort(np.lexsort((chance, turn))[:at_most])


def cells_of(points: NDArray[np.floating], cell_m: float) -> NDArray[np.int64]:
    """(n, 3) cube of each of (n, 3) points."""
    return np.floor(np.asarray(points, np.float64) / cell_m).astype(np.int64)

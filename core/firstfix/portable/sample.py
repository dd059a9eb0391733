"""Random samples of rows, the same for the same arguments.

Every k-th row is not a representative sample of an ordered list: rows that repeat with the period k are taken
either always or never. Examples are the beams of a scan, and the storeys of a column of viewpoints.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_MIX_1, _MIX_2 = np.uint32(0x85EBCA6B), np.uint32(0xC2B2AE35)


def rows_by_chance(count: int, at_most: int) -> NDArray[np.int64]:
    """Ascending rows of a list: one random row of each of ``at_most`` equal runs.

    The result is the same on every machine (clients/protocol/on-the-robot.md).

    Args:
        count: length of the list.
        at_most: number of rows. A shorter list gives all its rows.
    """
    if count <= at_most:
        return np.arange(count)
    start = np.arange(at_most + 1) * count // at_most
    width = np.diff(start)
    return start[:-1] + ((_hash(at_most) * width.astype(np.uint64)) >> np.uint64(32)).astype(np.int64)


def rows_by_place(
    points: NDArray[np.floating], at_most: int, cell_m: float, seed: int = 0
) -> NDArray[np.int64]:
    """Ascending rows of points that are evenly spread in space.

    Space is divided into cubes, so that storeys are separate. One random point of each cube is taken, then a
    second one of each, and so on. In the last round, the cubes that still get a point are random.

    Args:
        points: (n, 3) metres.
        at_most: number of rows. A shorter list gives all its rows.
        cell_m: edge of a cube.
    """
    count = len(points)
    if count <= at_most:
        return np.arange(count)
    order = np.random.default_rng(seed).permutation(count)
    cells = np.unique(cells_of(points, cell_m)[order], axis=0, return_inverse=True)[1].reshape(-1)
    by_cell = np.argsort(cells, kind="stable")  # within a cell: in random order
    starts = np.flatnonzero(np.diff(cells[by_cell], prepend=-1))
    turn = np.empty(count, np.int64)  # of each point: the number of points of its cell before it
    turn[by_cell] = np.arange(count) - np.repeat(starts, np.diff(starts, append=count))
    chosen = np.argsort(turn, kind="stable")[:at_most]  # random within a turn too
    return np.sort(order[chosen])


def cells_of(points: NDArray[np.floating], cell_m: float) -> NDArray[np.int64]:
    """Returns (n, 3) the cube of each of (n, 3) points."""
    return np.floor(np.asarray(points, np.float64) / cell_m).astype(np.int64)


def _hash(count: int) -> NDArray[np.uint64]:
    """Hashes of 0, 1, 2, ..., 32 bits each: the last steps of MurmurHash3."""
    x = np.arange(count, dtype=np.uint32)
    x ^= x >> np.uint32(16)
    x *= _MIX_1
    x ^= x >> np.uint32(13)
    x *= _MIX_2
    x ^= x >> np.uint32(16)
    return x.astype(np.uint64)

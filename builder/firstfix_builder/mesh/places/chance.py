"""Samples and roundings that a change of one part of a map leaves as they are elsewhere."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firstfix.bit_exact.sample import hashed


def begins_run(rows: NDArray[np.int64]) -> NDArray[np.bool_]:
    """(n,) whether each of (n, k) rows differs from the one before. The first does."""
    begins = np.ones(len(rows), np.bool_)
    begins[1:] = (rows[1:] != rows[:-1]).any(axis=1)
    return begins


def rank_in_run(rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """(n,) number of each of (n, k) rows within its run, from 0."""
    at = np.arange(len(rows))
    return at - np.maximum.accumulate(np.where(begins_run(rows), at, 0))


SPACING_STEPS = 12  # of an octave: 6 %
VIEW_STEPS = 6  # of an octave: 12 %


def stepped(value: float, per_octave: int) -> float:
    """The nearest power of 2 ** (1 / per_octave) to a positive value."""
    return float(2 ** (round(np.log2(value) * per_octave) / per_octave))


_SPREAD = np.uint32(0x9E3779B1)


def chance_of(points: NDArray[np.floating], seed: int) -> NDArray[np.uint32]:
    """(n,) a random number for each of (n, 3) points, made of its coordinates in single precision."""
    bits = (np.asarray(points, np.float32) + np.float32(0)).view(np.uint32)  # there is one zero only
    mixed = hashed(np.full(len(bits), seed, np.uint32))
    for column in bits.T:
        mixed = hashed(mixed * _SPREAD ^ column)
    return mixed


def rows_by_cell(
    points: NDArray[np.floating],
    cell_m: tuple[float, float, float],
    at_most: int,
    one_of: int = 1,
    seed: int = 0,
) -> NDArray[np.int64]:
    """Rows, ascending, of some random points of each cell: one of every ``one_of``, up to ``at_most``.

    Args:
        points: (n, 3) metres.
        cell_m: edges of a cell. Cells are counted from the frame's origin.
    """
    cell = np.floor(np.asarray(points, np.float64) / cell_m).astype(np.int64)
    order = np.lexsort((*points.T, chance_of(points, seed), *cell.T))
    count = np.diff(np.flatnonzero(begins_run(cell[order])), append=len(points))
    most = np.repeat(np.minimum(-(-count // one_of), at_most), count)
    return np.sort(order[rank_in_run(cell[order]) < most])


def rows_by_rank(points: NDArray[np.floating], at_most: int, seed: int = 0) -> NDArray[np.int64]:
    """Rows, in the order of chance, of up to ``at_most`` random points of (n, 3).

    Where some points are replaced, about as large a share of the sample is.
    """
    order = np.lexsort((*points.T, chance_of(points, seed)))
    return order[:at_most]

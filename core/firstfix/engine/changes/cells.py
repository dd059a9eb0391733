"""Cells of a map, and the spots from which they are seen."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

CELL_M = 0.5  # edge, along the axes of the map's own frame
SPOT_M = 1.0  # edge of a spot: scans from one spot show nearly the same, and share one vote
SLOTS = 32  # of a cell, for the spots from which it was seen
_HALF = 1 << 20  # a key has 21 bits for each axis: a thousand kilometres
_FACTORS = (0x9E3779B1, 0x85EBCA77, 0xC2B2AE3D)
_MASK = (1 << 64) - 1

Spot = tuple[int, int, int]


def cells_of(points_m: NDArray[np.floating]) -> NDArray[np.int64]:
    """(n, 3) integer cells of (n, 3) points in the map's frame."""
    return np.floor(np.asarray(points_m, np.float64) / CELL_M).astype(np.int64)


def keys_of(cells: NDArray[np.integer]) -> NDArray[np.int64]:
    """(n,) keys of (n, 3) cells, in the order of x, then y, then z.

    Raises:
        ValueError: a cell lies too far from the origin.
    """
    shifted = np.asarray(cells, np.int64) + _HALF
    if ((shifted < 0) | (shifted >= 2 * _HALF)).any():
        raise ValueError("a cell lies over 500 km from the map's origin")
    return (shifted[:, 0] << 42) | (shifted[:, 1] << 21) | shifted[:, 2]


def cells_of_keys(keys: NDArray[np.int64]) -> NDArray[np.int64]:
    """(n, 3) cells of (n,) keys."""
    mask = 2 * _HALF - 1
    return np.stack([keys >> 42, (keys >> 21) & mask, keys & mask], axis=1) - _HALF


def box_of(cells: NDArray[np.integer]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lowest and highest corner, (3,) metres each, of the box around (n, 3) cells."""
    return cells.min(axis=0) * CELL_M, (cells.max(axis=0) + 1) * CELL_M


def spot_of(position_m: NDArray[np.floating]) -> Spot:
    """Spot (x, y, z) in which a position (3,) of the map's frame lies."""
    x, y, z = np.floor(np.asarray(position_m, np.float64) / SPOT_M).astype(np.int64).tolist()
    return x, y, z


def slot_of(spot: Spot) -> int:
    """Slot, 0 <= slot < SLOTS, of a spot: the same in every process. Some spots share one."""
    mixed = sum(factor * (number & 0xFFFFFFFF) for factor, number in zip(_FACTORS, spot, strict=True))
    mixed = ((mixed ^ (mixed >> 29)) * 0xBF58476D1CE4E5B9) & _MASK
    return (mixed >> 32) % SLOTS

"""Free space carved by rays, and a scan's share in it, cell by cell."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

Cell = tuple[int, int, int]
_AROUND = list(product((-1, 0, 1), repeat=3))


def cells_of(points: NDArray[np.floating], cell_m: float) -> list[Cell]:
    """The cells of (n, 3) points."""
    return [(x, y, z) for x, y, z in np.floor(points / cell_m).astype(int).tolist()]


def passed(origin: NDArray[np.float64], end: NDArray[np.float64], cell_m: float) -> set[Cell]:
    """The cells between two points: those of the middles between all crossings of borders."""
    along = end - origin
    at = [0.0, 1.0]
    for start, length in zip(origin, along, strict=True):
        low, high = sorted([start, start + length])
        borders = np.arange(np.floor(low / cell_m), np.ceil(high / cell_m) + 1) * cell_m
        at += [] if length == 0 else [t for t in (borders - start) / length if 0 < t < 1]
    shares = np.sort(at)
    middles = (shares[1:] + shares[:-1]) / 2
    return set(cells_of(origin + middles[:, None] * along, cell_m))


def carved(
    origins: NDArray[np.float64],
    directions: NDArray[np.float32],
    ranges: NDArray[np.float32],
    back_off_m: float,
    cell_m: float,
) -> dict[Cell, int]:
    """How many of (k, 3) poses saw each cell free, by (n, 3) rays with (k, n) ranges."""
    counts: dict[Cell, int] = {}
    for origin, own in zip(origins, ranges.astype(np.float64), strict=True):
        seen: set[Cell] = set()
        for direction, range_m in zip(directions.astype(np.float64), own, strict=True):
            if np.isfinite(range_m) and range_m > back_off_m:
                seen |= passed(origin, origin + direction * (range_m - back_off_m), cell_m)
        for cell in seen:
            counts[cell] = counts.get(cell, 0) + 1
    return counts


def near(points: NDArray[np.floating], cell_m: float) -> set[Cell]:
    """The cells that hold a point, and those around them."""
    return {(x + i, y + j, z + k) for x, y, z in set(cells_of(points, cell_m)) for i, j, k in _AROUND}


def share(points: NDArray[np.float32], T: NDArray[np.float64], free: set[Cell], cell_m: float) -> float:
    """Share of (n, 3) points that lie in free cells at a pose."""
    placed = points.astype(np.float64) @ T[:3, :3].T + T[:3, 3]
    return sum(cell in free for cell in cells_of(placed, cell_m)) / max(1, len(points))


def cells_in(brick: NDArray[np.int32], bits: NDArray[np.int32]) -> set[Cell]:
    """The cells whose bit is set in (n, 8, 2) bits of (n, 3) bricks."""
    flags = np.unpackbits(np.ascontiguousarray(bits).view(np.uint8), bitorder="little").reshape(-1, 8, 8, 8)
    row, x, y, z = np.nonzero(flags)
    return {(a, b, c) for a, b, c in (8 * brick[row] + np.stack([x, y, z], axis=1)).tolist()}

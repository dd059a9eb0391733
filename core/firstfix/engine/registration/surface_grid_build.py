"""Construction of a surface grid, in parts: it needs little memory beside the map's own."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from ... import native

BLOCK_BITS = 2  # blocks of 4 cells a side: half of the cells in kept blocks are near the surface
GROUP_BITS = 2  # groups of 4 blocks a side, or more
MAX_GROUPS = 1 << 24  # entries of the table of all groups
PART = 1 << 20  # points at once
MAX_SLOTS = 1 << 22  # cells at once


@dataclass(frozen=True)
class CellsOf:
    """Cells of points, counted from the grid's corner.

    Attributes:
        position_m: (m, 3) of the points.
        cell_m: width of a cell.
        low: (3,) int64, the first cell, two before that of any point. Positions outside the grid go there.
        last: (3,) int64, the last cell counted from the first, two after that of any point.
    """

    position_m: NDArray[np.floating]
    cell_m: float
    low: NDArray[np.int64]
    last: NDArray[np.int64]

    @classmethod
    def points(cls, points: NDArray[np.floating], cell_m: float) -> CellsOf:
        """Cells of (m, 3) points in metres."""
        lowest, highest = points.min(axis=0), points.max(axis=0)
        low = np.floor(np.asarray(lowest, np.float64) / cell_m).astype(np.int64) - 2
        high = np.floor(np.asarray(highest, np.float64) / cell_m).astype(np.int64) + 2
        return cls(points, cell_m, low, high - low)

    @property
    def corner(self) -> NDArray[np.float32]:
        """(3,) lower corner of the first cell, metres."""
        return (self.low * self.cell_m).astype(np.float32)

    def parts(self) -> Iterator[slice]:
        """Slices of rows, small enough to work on one at a time."""
        for start in range(0, len(self.position_m), PART):
            yield slice(start, start + PART)

    def of(self, rows: slice | NDArray[np.integer]) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """Cells (k, 3) of some points, and the points' positions (k, 3) in them, 0..1."""
        scaled = np.asarray(self.position_m[rows], np.float64) / self.cell_m
        cell = np.floor(scaled).astype(np.int64) - self.low
        return cell.astype(np.int32), (scaled - self.low - cell).astype(np.float32)


def tables_around(cells: CellsOf) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Tables of the groups and blocks within one cell of a point."""
    bits = GROUP_BITS
    while np.prod((cells.last >> BLOCK_BITS + bits) + 1) > MAX_GROUPS:
        bits += 1
    near = np.zeros((cells.last >> BLOCK_BITS + bits) + 1, np.bool_)
    for blocks in _blocks_around(cells):
        near[tuple((blocks >> bits).T)] = True
    group = _numbered(near)
    kept = np.zeros((int(group.max()) + 1, *3 * (1 << bits,)), np.bool_)
    for blocks in _blocks_around(cells):
        number = group[tuple((blocks >> bits).T)]
        kept[(number, *(blocks & ((1 << bits) - 1)).T)] = True
    return group, _numbered(kept)


def _blocks_around(cells: CellsOf) -> Iterator[NDArray[np.int32]]:
    for rows in cells.parts():
        cell, _ = cells.of(rows)
        for corner in product((-1, 1), repeat=3):
            yield cell + np.array(corner, np.int32) >> BLOCK_BITS


def _numbered(kept: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Numbers 1, 2, ... of the kept entries, 0 for the others."""
    number = np.zeros(kept.shape, np.int32)
    number[kept] = np.arange(1, kept.sum() + 1)
    return number


def nearest_points(cells: CellsOf, group: NDArray[np.int32], block: NDArray[np.int32]) -> NDArray[np.int32]:
    """Points (kept blocks, s, s, s) nearest to each cell's centre.

    Slab after slab along x: the groups of a slab have consecutive numbers, and so have their blocks.
    """
    side = 1 << BLOCK_BITS
    point = np.full((int(block.max()) + 1, side, side, side), -1, np.int32)
    for rows, first, end in _slabs(cells, group, block):
        cell, offset = cells.of(rows)
        point[first:end] = native.nearest_points(cell, offset, rows, group, block, BLOCK_BITS, first, end)
    return point


def _slabs(
    cells: CellsOf, group: NDArray[np.int32], block: NDArray[np.int32]
) -> Iterator[tuple[NDArray[np.int32], int, int]]:
    """Yield for each slab the rows of points in and beside it, its first block, and the one after its last.

    Slabs are at least one group thick, and as thick as MAX_SLOTS allows.
    """
    thick = block.shape[1] << BLOCK_BITS  # cells of a group
    x = [cells.of(rows)[0][:, 0].copy() for rows in cells.parts()]
    ends_of_x = [(int(part.min()), int(part.max())) for part in x]
    groups = group.reshape(len(group), -1).max(axis=1)  # last group of every x, 0 if there is none
    last_group = np.maximum.accumulate(groups)
    blocks = np.maximum.accumulate(block.reshape(len(block), -1).max(axis=1))
    ends = blocks[last_group] + 1  # for every x, the block after its last
    begin, first = 0, 1
    for gx in range(len(group)):
        full = gx + 1 == len(group) or ends[gx + 1] - first > MAX_SLOTS >> 3 * BLOCK_BITS
        if full:
            yield _rows_within(x, ends_of_x, begin * thick - 1, (gx + 1) * thick), first, int(ends[gx])
            begin, first = gx + 1, int(ends[gx])


def _rows_within(
    parts: Sequence[NDArray[np.int32]], ends: Sequence[tuple[int, int]], low: int, high: int
) -> NDArray[np.int32]:
    """Rows of numbers from low to high, in ascending order.

    Args:
        parts: the numbers, PART at a time.
        ends: least and largest of each part. Neighbours in space are in few parts: the others are passed
            over.
    """
    found = [np.zeros(0, np.int32)]
    for number, (part, (least, largest)) in enumerate(zip(parts, ends, strict=True)):
        if least <= high and largest >= low:
            inside = np.flatnonzero((part >= low) & (part <= high))
            found.append((inside + number * PART).astype(np.int32))
    return np.concatenate(found)

"""The nearest surface point to any place near a surface, in constant time.

A KD tree over a million points costs a microsecond a look-up, all of it cache misses, and registration
asks ten thousand times a query. Here every cell near the surface names the point nearest to its centre:
a look-up is two array reads, and thousands are one NumPy call.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .array_file import map_arrays, save_arrays
from .surface import Surface

_BLOCK_BITS = 2  # blocks of 4 cells a side: half of those that are kept are near the surface
_MOST_BLOCKS = 1 << 25  # entries of the block table; blocks grow with the extent
_NOTHING = np.iinfo(np.int64).max


@dataclass(frozen=True)
class SurfaceGrid:
    """Cells in blocks of s a side, of which only those near the surface are kept. Thread-safe.

    Every point is known in its own cell and the 26 around it: what lies within a cell's width of a
    surface always finds it, what lies beyond two never does.

    Attributes:
        cell: (1,) float32, its width in metres.
        corner: (3,) float32, metres, below everything: from it float32 counts finely enough.
        planes: (m, 4) float32, at each point of the surface its normal and how far along it the point
            lies from the corner.
        oriented: (m,) as the surface's.
        block: (bx, by, bz) int32, which of the kept blocks stands there; the first is that of nothing.
        point: (kept, s, s, s) int32, the point nearest to each cell's centre, -1 where none is near.
    """

    cell: NDArray[np.float32]
    corner: NDArray[np.float32]
    planes: NDArray[np.float32]
    oriented: NDArray[np.bool_]
    block: NDArray[np.int32]
    point: NDArray[np.int32]

    @classmethod
    def of(cls, surface: Surface, cell_m: float) -> SurfaceGrid:
        scaled = np.asarray(surface.points, np.float64) / cell_m
        cell = np.floor(scaled).astype(np.int64)
        low = cell.min(axis=0) - 2  # a margin of empty cells, where everything outside is sent
        corner = (low * cell_m).astype(np.float32)
        along = np.einsum("ij,ij->i", surface.normals, surface.points - corner)
        cell -= low
        block, bits = _blocks_around(cell)
        return cls(
            np.array([cell_m], np.float32),
            corner,
            np.column_stack([surface.normals, along]),
            surface.oriented,
            block,
            _nearest_points(cell, (scaled - low - cell).astype(np.float32), block, bits),
        )

    def nearest(self, points: NDArray[np.float32]) -> NDArray[np.int32]:
        """(n, 3) from the corner to (n,) rows of the surface, -1 where none is near."""
        side = self.point.shape[1]
        last = np.array(self.block.shape, np.float32) * side - 1
        cell = (points * (1 / self.cell)).clip(0, last).astype(np.int32)
        return self.point.ravel()[_slot(cell, self.block, side.bit_length() - 1)]

    def save(self, path: Path) -> None:
        save_arrays(path, {field.name: getattr(self, field.name) for field in fields(self)})

    @classmethod
    def load(cls, path: Path) -> SurfaceGrid:
        """Memory-mapped.

        Raises:
            ValueError, TypeError, OSError: it is no such file.
        """
        return cls(**map_arrays(path))


def _slot(cell: NDArray[np.integer], block: NDArray[np.int32], bits: int) -> NDArray[np.int64]:
    """(n, 3) cells to their place among those of the kept blocks."""
    x, y, z = (cell >> bits).T
    _, columns, layers = block.shape
    inner = cell & ((1 << bits) - 1)
    within = ((inner[:, 0] << bits) + inner[:, 1] << bits) + inner[:, 2]
    return (block.ravel()[(x * columns + y) * layers + z].astype(np.int64) << 3 * bits) + within


def _blocks_around(cell: NDArray[np.int64]) -> tuple[NDArray[np.int32], int]:
    """The block table, and the bits of a cell's place within its block.

    Args:
        cell: (m, 3) of every point, none below 2.
    """
    last, bits = cell.max(axis=0) + 2, _BLOCK_BITS
    while np.prod((last + 1) / (1 << bits)) > _MOST_BLOCKS:
        bits += 1
    kept = np.zeros((last >> bits) + 1, np.bool_)
    for corner in product((-1, 1), repeat=3):
        kept[tuple((cell + corner >> bits).T)] = True
    block = np.zeros(kept.shape, np.int32)
    block[kept] = np.arange(1, kept.sum() + 1)
    return block, bits


def _nearest_points(
    cell: NDArray[np.int64], offset: NDArray[np.float32], block: NDArray[np.int32], bits: int
) -> NDArray[np.int32]:
    """
    Args:
        offset: (m, 3) 0..1, of every point in its cell.
    """
    shape = (int(block.max()) + 1, *3 * (1 << bits,))
    best = np.full(int(np.prod(shape)), _NOTHING)  # squared distance in the high bits, row in the low
    row = np.arange(len(cell))
    for step in product((-1, 0, 1), repeat=3):
        distance2 = np.square(offset - np.asarray(step, np.float32) - np.float32(0.5)).sum(axis=1)
        entry = (distance2 * 2**20).astype(np.int64) << 32 | row
        np.minimum.at(best, _slot(cell + step, block, bits), entry)
    return np.where(best == _NOTHING, -1, best & 0xFFFFFFFF).astype(np.int32).reshape(shape)

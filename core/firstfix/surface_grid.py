"""The nearest surface point to any place near a surface, in constant time.

A KD tree over a million points costs a microsecond a look-up, all of it cache misses, and registration
asks ten thousand times a query. Here every cell near the surface names the point nearest to its centre:
a look-up is two array reads, and thousands are one NumPy call.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from .surface import Surface

_MOST_BLOCKS = 1 << 25  # entries of the block table; blocks grow with the extent
_NOTHING = np.iinfo(np.int64).max


class SurfaceGrid:
    """Cells of ``cell_m`` in blocks, of which only those near the surface are kept. Thread-safe.

    Every point is known in its own cell and the 26 around it: what lies within a cell's width of a
    surface always finds it, what lies beyond two never does.

    Attributes:
        corner: (3,) float32, metres, below everything: from it float32 counts finely enough.
        planes: (m, 4) float32, at each point of the surface its normal and how far along it the point
            lies from the corner.
        oriented: (m,) as the surface's.
    """

    def __init__(self, surface: Surface, cell_m: float) -> None:
        scaled = np.asarray(surface.points, np.float64) / cell_m
        cell = np.floor(scaled).astype(np.int64)
        low = cell.min(axis=0) - 2  # a margin of empty cells, where everything outside is sent
        self._per_m, self.corner = np.float32(1 / cell_m), (low * cell_m).astype(np.float32)
        along = np.einsum("ij,ij->i", surface.normals, surface.points - self.corner)
        self.planes, self.oriented = np.column_stack([surface.normals, along]), surface.oriented
        self._last = (cell.max(axis=0) - low + 2).astype(np.float32)
        self._bits = 3
        while np.prod((self._last + 1) / (1 << self._bits)) > _MOST_BLOCKS:
            self._bits += 1
        cell -= low
        self._block = self._blocks_around(cell)
        self._nearest = self._nearest_points(cell, (scaled - low - cell).astype(np.float32))

    def nearest(self, points: NDArray[np.float32]) -> NDArray[np.int32]:
        """(n, 3) from the corner to (n,) rows of the surface, -1 where none is near."""
        cell = (points * self._per_m).clip(0, self._last).astype(np.int32)
        return self._nearest[self._slot(cell)]

    def _slot(self, cell: NDArray[np.integer]) -> NDArray[np.int64]:
        """(n, 3) cells to their place in the kept blocks."""
        x, y, z = (cell >> self._bits).T
        _, columns, layers = self._block.shape
        inner = cell & ((1 << self._bits) - 1)
        within = ((inner[:, 0] << self._bits) + inner[:, 1] << self._bits) + inner[:, 2]
        return self._block.ravel()[(x * columns + y) * layers + z] + within

    def _blocks_around(self, cell: NDArray[np.int64]) -> NDArray[np.int64]:
        """(bx, by, bz) where each block's cells begin; the first block is that of nothing."""
        blocks = (self._last.astype(np.int64) >> self._bits) + 1
        kept = np.zeros(blocks, np.bool_)
        for corner in product((-1, 1), repeat=3):
            kept[tuple((cell + corner >> self._bits).T)] = True
        begin = np.zeros(blocks, np.int64)
        begin[kept] = np.arange(1, kept.sum() + 1) << 3 * self._bits
        return begin

    def _nearest_points(self, cell: NDArray[np.int64], offset: NDArray[np.float32]) -> NDArray[np.int32]:
        """
        Args:
            offset: (m, 3) 0..1, of every point in its cell.
        """
        cells = int(self._block.max()) + (1 << 3 * self._bits)
        best = np.full(cells, _NOTHING)  # squared distance in the high bits, row in the low
        row = np.arange(len(cell))
        for step in product((-1, 0, 1), repeat=3):
            distance2 = np.square(offset - np.asarray(step, np.float32) - np.float32(0.5)).sum(axis=1)
            np.minimum.at(best, self._slot(cell + step), (distance2 * 2**20).astype(np.int64) << 32 | row)
        return np.where(best == _NOTHING, -1, best & 0xFFFFFFFF).astype(np.int32)

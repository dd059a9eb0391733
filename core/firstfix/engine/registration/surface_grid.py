"""The nearest surface point to any place near a surface, in constant time.

A KD tree over a million points costs a microsecond a look-up, all of it cache misses, and registration
asks ten thousand times a query. Here every cell near the surface names the point nearest to its centre:
a look-up is three array reads, and thousands are one NumPy call.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..array_file import map_arrays, save_arrays
from .surface import Surface
from .surface_grid_build import CellsOf, nearest_points, slot_of, tables_around


@dataclass(frozen=True)
class SurfaceGrid:
    """Cells in blocks of s a side, these in groups of g a side, of both only those near the surface. A table
    of the whole space is as small as its groups are large, so it may be kilometres wide. Thread-safe.

    Every point is known in its own cell and the 26 around it: what lies within a cell's width of a
    surface always finds it, what lies beyond two never does.

    Attributes:
        cell: (1,) float32, its width in metres.
        corner: (3,) float32, metres, below everything: from it float32 counts finely enough.
        planes: (m, 4) float32, at each point of the surface its normal and how far along it the point
            lies from the corner.
        oriented: (m,) as the surface's.
        group: (gx, gy, gz) int32, which of the kept groups stands there; the first is that of nothing.
        block: (kept groups, g, g, g) int32, which of the kept blocks; the first is that of nothing.
        point: (kept blocks, s, s, s) int32, the point nearest to each cell's centre, -1 where none is near.
    """

    cell: NDArray[np.float32]
    corner: NDArray[np.float32]
    planes: NDArray[np.float32]
    oriented: NDArray[np.bool_]
    group: NDArray[np.int32]
    block: NDArray[np.int32]
    point: NDArray[np.int32]

    @classmethod
    def of(cls, surface: Surface, cell_m: float) -> SurfaceGrid:
        cells = CellsOf.points(surface.points, cell_m)
        planes = np.empty((len(surface), 4), np.float32)
        planes[:, :3] = surface.normals
        for rows in cells.parts():
            away = surface.points[rows] - cells.corner
            planes[rows, 3] = np.einsum("ij,ij->i", surface.normals[rows], away)
        group, block = tables_around(cells)
        point = nearest_points(cells, group, block)
        return cls(
            np.array([cell_m], np.float32), cells.corner, planes, surface.oriented, group, block, point
        )

    def nearest(self, points: NDArray[np.float32]) -> NDArray[np.int32]:
        """(n, 3) from the corner to (n,) rows of the surface, -1 where none is near."""
        block_bits = self.point.shape[1].bit_length() - 1
        group_bits = block_bits + self.block.shape[1].bit_length() - 1
        last = np.array(self.group.shape, np.float32) * (1 << group_bits) - 1
        cell = (points * (1 / self.cell)).clip(0, last).astype(np.int32)
        return self.point.ravel()[slot_of(cell, self.group, self.block, block_bits)]

    def save(self, path: Path) -> None:
        save_arrays(path, {field.name: getattr(self, field.name) for field in fields(self)})

    @classmethod
    def load(cls, path: Path) -> SurfaceGrid:
        """Memory-mapped.

        Raises:
            ValueError, TypeError, OSError: it is no such file.
        """
        return cls(**map_arrays(path))

"""Grid that finds the surface point near any position, in constant time.

A look-up in a KD tree over a million points takes a microsecond, mostly cache misses, and a query makes a
hundred thousand of them. Here every cell near the surface stores the point nearest to its centre: a look-up
is three array reads. That point may lie on the other face of a thin wall, so each point names the one
behind it.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ... import native
from ..array_file import map_arrays, save_arrays
from ..made_of import MadeOf, always
from .surface import Surface
from .surface_grid_build import GridFrame, grid_tables

PART = 1 << 20  # points at once


@dataclass(frozen=True)
class SurfaceGrid:
    """Sparse grid in three levels: groups of g blocks a side, blocks of s cells a side. Thread-safe.

    Only groups and blocks near the surface are kept, so the grid may be kilometres wide. Every point is
    stored in its own cell and in the 26 around it: a position within one cell's width of a surface always
    finds it, a position beyond two never does.

    Attributes:
        cell: (1,) float32, width of a cell in metres.
        corner: (3,) float32, metres, below all points. Relative to it float32 is fine enough.
        planes: (m, 4) float32, for each surface point its normal and its distance along it from the corner.
        oriented: (m,) as in the surface.
        other_face: (m,) int32, the nearest point within two cells that faces the other way; -1: none.
        group: (gx, gy, gz) int32, number of the kept group at each position; 0: none.
        block: (kept groups, g, g, g) int32, number of the kept block at each position; 0: none.
        point: (kept blocks, s, s, s) int32, point nearest to each cell's centre; -1: none.
    """

    cell: NDArray[np.float32]
    corner: NDArray[np.float32]
    planes: NDArray[np.float32]
    oriented: NDArray[np.bool_]
    other_face: NDArray[np.int32]
    group: NDArray[np.int32]
    block: NDArray[np.int32]
    point: NDArray[np.int32]

    def __post_init__(self) -> None:
        _ = self.tables  # checks types and shapes

    def __getstate__(self) -> dict[str, Any]:
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @cached_property
    def tables(self) -> native.SurfaceGrid:
        """The arrays as the kernels read them."""
        return native.SurfaceGrid(
            float(self.cell.item()),
            self.corner,
            self.planes,
            self.oriented,
            self.other_face,
            self.group,
            self.block,
            self.point,
        )

    @classmethod
    def of(cls, surface: Surface, cell_m: float, made_of: MadeOf = always) -> SurfaceGrid:
        """Grid of a surface.

        Args:
            made_of: makes the part of a tile, or takes that of an earlier build with the same surface there.
        """
        frame = GridFrame.of(surface.points, cell_m)
        planes = np.empty((len(surface), 4), np.float32)
        planes[:, :3] = surface.normals
        for start in range(0, len(surface), PART):
            rows = slice(start, start + PART)
            away = surface.points[rows] - frame.corner
            planes[rows, 3] = np.einsum("ij,ij->i", surface.normals[rows], away)
        made = grid_tables(surface, frame, made_of)
        cell = np.array([cell_m], np.float32)
        return cls(
            cell,
            frame.corner,
            planes,
            surface.oriented,
            made.other_face,
            made.group,
            made.block,
            made.point,
        )

    def nearest(self, points: NDArray[np.float32]) -> NDArray[np.int32]:
        """Rows (n,) of the surface near (n, 3) positions relative to the corner; -1: none."""
        return self.tables.nearest(points)

    def save(self, path: Path) -> None:
        """Write the grid to a file."""
        save_arrays(path, {field.name: getattr(self, field.name) for field in fields(self)})

    @classmethod
    def load(cls, path: Path) -> SurfaceGrid:
        """Read a file that ``save`` wrote, memory-mapped.

        Raises:
            ValueError, TypeError, OSError: the file has another format or cannot be read.
        """
        return cls(**map_arrays(path))

"""A mesh whose triangles are sorted by tile, so that work at one place reads only triangles near it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .map_tiles import by_tiles
from .mesh import Mesh
from .places.surface_cells import SurfaceCells

TILE_M = 32.0


@dataclass(frozen=True)
class TiledMesh:
    """A mesh whose triangles are sorted by tile.

    Attributes:
        mesh: its vertices stand in the order in which the triangles first use them.
        start: (k + 1,) int64, tile i holds ``mesh.triangles[start[i]:start[i + 1]]``.
        low, high: (k, 2) metres, the corners of the box in x and y that holds a tile's triangles whole.
    """

    mesh: Mesh
    start: NDArray[np.int64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]

    @classmethod
    def of(cls, mesh: Mesh) -> TiledMesh:
        """Sorts a mesh of at least one triangle, and removes unused vertices."""
        order, start = by_tiles(mesh.vertices[mesh.triangles].mean(axis=1), TILE_M)
        triangles = mesh.triangles[order]
        used, first = np.unique(triangles, return_index=True)
        used = used[np.argsort(first)]
        number = np.zeros(len(mesh.vertices), np.int64)
        number[used] = np.arange(len(used))
        ordered = Mesh(mesh.vertices[used], number[triangles])
        corners = ordered.vertices[ordered.triangles, :2]
        low = np.minimum.reduceat(corners.min(axis=1), start[:-1])
        high = np.maximum.reduceat(corners.max(axis=1), start[:-1])
        return cls(ordered, start, low, high)

    def save(self, directory: Path) -> None:
        """Writes the files of ``Mesh.save`` and ``SurfaceCells.save``, tile_start.npy and tile_box.npy."""
        self.mesh.save(directory)
        SurfaceCells.of(self.mesh.vertices, self.mesh.triangles).save(directory)
        np.save(directory / "tile_start.npy", self.start)
        np.save(directory / "tile_box.npy", np.stack([self.low, self.high]))

    @classmethod
    def load(cls, directory: Path) -> TiledMesh:
        """Loads a mesh, memory-mapped: only the parts in use are read from the disk."""
        vertices, triangles = (
            np.load(directory / f"{n}.npy", mmap_mode="r") for n in ("vertices", "triangles")
        )
        low, high = np.load(directory / "tile_box.npy")
        return cls(Mesh(vertices, triangles), np.load(directory / "tile_start.npy"), low, high)

    def near(self, low: NDArray[np.float64], high: NDArray[np.float64], reach_m: float) -> tuple[int, ...]:
        """Returns the tiles within reach_m of the box of (2,) corners, and always the nearest one."""
        gap_m = np.maximum(np.maximum(self.low - high, low - self.high), 0)
        away_m = np.hypot(gap_m[:, 0], gap_m[:, 1])
        return tuple(np.flatnonzero(away_m <= max(reach_m, float(away_m.min()))).tolist())

    def part(self, tiles: tuple[int, ...]) -> Mesh:
        """The triangles of the given tiles, in their order."""
        if len(tiles) == len(self.low):
            return self.mesh
        triangles = np.concatenate([self.mesh.triangles[self.start[i] : self.start[i + 1]] for i in tiles])
        used, corner = np.unique(triangles, return_inverse=True)
        return Mesh(self.mesh.vertices[used], corner.reshape(-1, 3))

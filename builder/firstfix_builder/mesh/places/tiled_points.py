"""A cloud sorted by tile, so that work at one place reads only the points near it."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .chance import begins_run

TILE_M = 8.0
_POINTS, _TILES = "points.npy", "point_tiles.npz"


@dataclass(frozen=True)
class TiledPoints:
    """A cloud in tiles of the ground plane, which are counted from the map's origin.

    Attributes:
        points: (n, 3) metres, tile by tile; within a tile in their former order.
        tile: (k, 2) int64 number of each tile in x and y.
        start: (k + 1,) int64, tile i holds ``points[start[i]:start[i + 1]]``.
        sha256: (k, 32) uint8 of each tile's points.
    """

    points: NDArray[np.float64]
    tile: NDArray[np.int64]
    start: NDArray[np.int64]
    sha256: NDArray[np.uint8]

    @classmethod
    def of(cls, points: NDArray[np.float64]) -> TiledPoints:
        """Tiles of (n, 3) points, one or more."""
        return cls.sorted(points)[0]

    @classmethod
    def sorted(cls, points: NDArray[np.float64]) -> tuple[TiledPoints, NDArray[np.intp]]:
        """Tiles of (n, 3) points, one or more, and (n,) the row that each had before."""
        number = np.floor(points[:, :2] / TILE_M).astype(np.int64)
        order = np.lexsort((number[:, 1], number[:, 0]))
        ordered, number = points[order], number[order]
        first = np.flatnonzero(begins_run(number))
        start = np.append(first, len(points)).astype(np.int64)
        found = [hashlib.sha256(ordered[a:b].tobytes()).digest() for a, b in pairwise(start.tolist())]
        sha256 = np.frombuffer(b"".join(found), np.uint8).reshape(-1, 32)
        return cls(ordered, number[first], start, sha256), order

    def save(self, directory: Path) -> None:
        """Write ``points.npy`` and ``point_tiles.npz``."""
        np.save(directory / _POINTS, self.points)
        np.savez(directory / _TILES, tile=self.tile, start=self.start, sha256=self.sha256)

    @classmethod
    def load(cls, directory: Path) -> TiledPoints:
        """Load a cloud, memory-mapped: only the parts in use are read from the disk."""
        with np.load(directory / _TILES) as tiles:
            return cls(np.load(directory / _POINTS, mmap_mode="r"), **dict(tiles))

    def near(self, low: NDArray[np.float64], high: NDArray[np.float64]) -> NDArray[np.float64]:
        """The points of the tiles that meet the box of (2,) corners, tile by tile."""
        parts = [self.points[self.start[i] : self.start[i + 1]] for i in self._tiles(low, high)]
        return np.concatenate(parts) if parts else np.zeros((0, 3))

    def digest_near(self, low: NDArray[np.float64], high: NDArray[np.float64]) -> str:
        """A hash of what ``near`` returns."""
        tiles = self._tiles(low, high)
        return hashlib.sha256(self.tile[tiles].tobytes() + self.sha256[tiles].tobytes()).hexdigest()

    def _tiles(self, low: NDArray[np.float64], high: NDArray[np.float64]) -> NDArray[np.intp]:
        meets = (self.tile * TILE_M <= high) & ((self.tile + 1) * TILE_M >= low)
        return np.flatnonzero(meets.all(axis=1))

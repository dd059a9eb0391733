"""Map points in square tiles, to find those around a position."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ... import native
from ...scan.reduction import voxel_means
from ..array_file import map_arrays, save_arrays
from ..made_of import MadeOf, always
from ..registration.tile_rows import cells_a_tile, columns_of, tile_rows
from ..retrieval.tile_table import runs_around, tile_table


@dataclass(frozen=True)
class PointTiles:
    """Points, sorted by tile in columns along y. Thread-safe.

    Attributes:
        points: (n, 3) float32 metres, tile after tile.
        begin: (columns, rows + 1) int32, tile (x, y) holds ``points[begin[x, y]:begin[x, y + 1]]``.
        low: (2,) int32, x and y of the first tile, in tiles.
    """

    points: NDArray[np.float32]
    begin: NDArray[np.int32]
    low: NDArray[np.int32]

    def __post_init__(self) -> None:
        _ = self.tables  # checks types and shapes

    def __getstate__(self) -> dict[str, Any]:
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @cached_property
    def tables(self) -> native.PointTiles:
        """The arrays as the kernels read them."""
        return native.PointTiles(self.points, self.begin, self.low)

    @classmethod
    def of(cls, points: NDArray[np.floating], voxel_m: float, made_of: MadeOf = always) -> PointTiles:
        """Tiles of (n, 3) points, thinned to one point a voxel.

        Args:
            made_of: thins the points of a part of the map, or takes what an earlier build made of them.
        """

        def means(part: NDArray[np.floating]) -> NDArray[np.float64]:
            content = [part, np.array(voxel_m)]
            return made_of("view", content, lambda: {"points": voxel_means(part, voxel_m)})["points"]

        tiles = tile_rows(columns_of(points, voxel_m), cells_a_tile(voxel_m))
        thinned = np.concatenate([means(points[one.rows]) for one in tiles])
        order, begin, low = tile_table(thinned)
        return cls(thinned[order].astype(np.float32), begin, low)

    def around(self, centre: NDArray[np.floating], reach_m: float) -> NDArray[np.float32]:
        """(m, 3) points of all tiles within reach of a (2 or more,) centre along x and y."""
        runs = runs_around(self.begin, self.low, centre, reach_m)
        return np.concatenate([self.points[:0], *(self.points[run] for run in runs)])

    def save(self, path: Path) -> None:
        """Write the tiles to a file."""
        save_arrays(path, {field.name: getattr(self, field.name) for field in fields(self)})

    @classmethod
    def load(cls, path: Path) -> PointTiles:
        """Read a file that ``save`` wrote, memory-mapped.

        Raises:
            ValueError, TypeError, OSError: the file has another format or cannot be read.
        """
        return cls(**map_arrays(path))

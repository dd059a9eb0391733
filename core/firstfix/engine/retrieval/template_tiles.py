"""Templates in square tiles, to find those near a position."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..array_file import check_numbers, map_arrays, save_arrays
from .tile_table import runs_around, tile_table

FILE = "template_tiles.safetensors"


@dataclass(frozen=True)
class TemplateTiles:
    """Rows of n templates, sorted by tile in columns along y.

    Attributes:
        row: (n,) int32, tile after tile, ascending in each.
        begin: (columns, rows + 1) int32, in tile (x, y) are ``row[begin[x, y]:begin[x, y + 1]]``.
        low: (2,) int32, x and y of the first tile, in tiles.
    """

    row: NDArray[np.int32]
    begin: NDArray[np.int32]
    low: NDArray[np.int32]

    @classmethod
    def of(cls, position_m: NDArray[np.floating]) -> TemplateTiles:
        """Tiles of templates at (n, 3) positions in metres."""
        order, begin, low = tile_table(position_m)
        return cls(order.astype(np.int32), begin, low)

    def within(
        self, position_m: NDArray[np.floating], centre: NDArray[np.float64], radius_m: float
    ) -> NDArray[np.int32]:
        """Rows, ascending, of the templates inside a sphere.

        Args:
            position_m: (n, 3) of all templates.
            centre: (3,) metres.
            radius_m: of the sphere.
        """
        rows = self._around(centre, radius_m)
        near: NDArray[np.int32] = rows[np.linalg.norm(position_m[rows] - centre, axis=1) <= radius_m]
        return near

    def _around(self, centre: NDArray[np.float64], radius_m: float) -> NDArray[np.int32]:
        """Rows, ascending, of the templates in all tiles within reach, at any height."""
        runs = runs_around(self.begin, self.low, centre, radius_m)
        return np.sort(np.concatenate([self.row[:0], *(self.row[run] for run in runs)]))

    def save(self, directory: Path) -> None:
        """Write a version's file."""
        save_arrays(directory / FILE, {field.name: getattr(self, field.name) for field in fields(self)})

    @classmethod
    def load(cls, directory: Path, position_m: NDArray[np.floating]) -> TemplateTiles:
        """Read a version's file, memory-mapped.

        Args:
            directory: of the version's files.
            position_m: (n, 3) of the version's templates.

        Raises:
            ValueError, TypeError, OSError: the file has another format, does not fit the templates, or cannot
                be read.
        """
        tiles = cls(**map_arrays(directory / FILE))
        if len(tiles.row) != len(position_m):
            raise ValueError(f"{FILE} has {len(tiles.row)} templates, not {len(position_m)}")
        check_numbers(f"{FILE}: row", tiles.row, len(tiles.row))
        check_numbers(f"{FILE}: begin", tiles.begin, len(tiles.row) + 1, ascending=True)
        return tiles

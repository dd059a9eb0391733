"""The square tiles in which viewpoints are sampled, one by one."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firstfix.errors import BuildFailed

from .floors import Grid

MAX_CELL_M = 0.4
SIDE_M = 32.0  # about; a whole number of blocks
SHARED_TILES = 4  # along each edge of the larger tiles whose chunks share a part of the mesh
MAX_TILES = 500_000  # 500 square kilometres
MAX_COLUMN = 1 << 26  # from the map's zero, so that a surface has a number of 64 bits


def in_order(tiles: Iterable[tuple[int, int]]) -> list[tuple[int, int]]:
    """Tiles in the order in which they are worked at: larger tile by larger tile."""
    return sorted(tiles, key=lambda tile: (tile[0] // SHARED_TILES, tile[1] // SHARED_TILES, tile))


@dataclass(frozen=True)
class Tiling:
    """Tiles of a whole number of blocks, which are counted from the map's zero.

    Attributes:
        spacing_m: edge of a block, in which one viewpoint stands.
    """

    spacing_m: float

    @property
    def cell_m(self) -> float:
        """Edge of a cell, whose middle is looked at."""
        return self.spacing_m / self._cells

    @property
    def side_m(self) -> float:
        """Edge of a tile."""
        return self._blocks * self.spacing_m

    @property
    def side_cells(self) -> int:
        """Cells along the edge of a tile."""
        return self._blocks * self._cells

    @property
    def _cells(self) -> int:
        """Cells along a block."""
        return int(np.ceil(self.spacing_m / MAX_CELL_M))

    @property
    def _blocks(self) -> int:
        """Blocks along a tile: an even number, so that blocks of twice the spacing lie in one tile."""
        return 2 * max(1, round(SIDE_M / (2 * self.spacing_m)))

    def grid(self, tile: tuple[int, int], border_cells: int) -> Grid:
        """The cells of a tile with a border."""
        low = np.array(tile, np.int64) * self.side_cells - border_cells
        return Grid(self.cell_m, low, np.full(2, self.side_cells + 2 * border_cells))

    def box(self, tile: tuple[int, int]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The (2,) corners of a tile."""
        low = np.array(tile, np.float64) * self.side_m
        return low, low + self.side_m

    def over(self, low: NDArray[np.float64], high: NDArray[np.float64]) -> list[tuple[int, int]]:
        """The tiles that meet any of k boxes, in order.

        Args:
            low, high: (k, 2) corners in metres.

        Raises:
            BuildFailed: there are too many, or they are too far from the map's zero.
        """
        first = np.floor(low / self.side_m)
        count = np.floor(high / self.side_m) - first + 1
        far = max(np.abs(low).max(), np.abs(high).max()) / self.cell_m >= MAX_COLUMN - 1e4
        if far or (count[:, 0] * count[:, 1]).max() > MAX_TILES:
            raise BuildFailed(
                f"the map is too large for cells of {self.cell_m:.2f} m: set a larger spacing_m"
            )
        found: set[tuple[int, int]] = set()
        for corner, size in zip(first.astype(int).tolist(), count.astype(int).tolist(), strict=True):
            found.update((corner[0] + x, corner[1] + y) for x in range(size[0]) for y in range(size[1]))
            if len(found) > MAX_TILES:
                raise BuildFailed(f"the map covers more than {MAX_TILES} tiles of {self.side_m:g} m")
        return in_order(found)

    def of(self, points: NDArray[np.floating]) -> NDArray[np.int64]:
        """(n, 2) tile that each of (n, 2) or (n, 3) points stands in."""
        return np.floor(np.asarray(points[:, :2], np.float64) / self.side_m).astype(np.int64)

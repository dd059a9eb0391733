"""The polar grid that every descriptor bins a levelled scan into (paper III.A: 20 rings x 60 sectors)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class PolarGrid:
    """Rings of equal width up to ``max_range_m``, sectors of equal angle from the x axis.

    Attributes:
        rings, sectors: how many.
        max_range_m: horizontal distance where the last ring ends; points beyond are in no cell.
    """

    rings: int = 20
    sectors: int = 60
    max_range_m: float = 60.0

    def __post_init__(self) -> None:
        if not (1 <= self.rings <= 1000 and 1 <= self.sectors <= 3600 and self.max_range_m > 0):
            raise ValueError(f"not a usable grid: {self}")

    def cells(
        self, x: NDArray[np.floating], y: NDArray[np.floating]
    ) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """(p,) coordinates to the (k,) rows inside the grid and their (k,) cells, ring * sectors + sector."""
        radius = np.hypot(x, y)
        inside = np.flatnonzero(radius < self.max_range_m)
        if len(inside) < len(x):
            x, y, radius = x[inside], y[inside], radius[inside]
        ring = (radius * np.float32(self.rings / self.max_range_m)).astype(np.intp)
        np.minimum(ring, self.rings - 1, out=ring)  # a radius a hair below the end may round up
        turn = np.arctan2(y, x)
        turn *= np.float32(self.sectors / (2 * np.pi))
        sector = np.floor(turn).astype(np.intp)
        sector[sector < 0] += self.sectors  # arctan2 gives -pi..pi: the cell before 0 is the last
        np.minimum(sector, self.sectors - 1, out=sector)
        return inside, ring * self.sectors + sector

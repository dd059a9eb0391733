"""Polar grid into which descriptors bin a levelled scan (paper III.A: 20 rings x 60 sectors)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..bit_exact.atan2 import atan2_turns


@dataclass(frozen=True)
class PolarGrid:
    """Rings of equal width up to ``max_range_m``, sectors of equal angle from the x axis.

    Attributes:
        rings, sectors: their numbers.
        max_range_m: horizontal distance at which the last ring ends. Points beyond are in no cell.
    """

    rings: int = 20
    sectors: int = 60
    max_range_m: float = 60.0

    def __post_init__(self) -> None:
        if not (1 <= self.rings <= 1000 and 1 <= self.sectors <= 3600 and self.max_range_m > 0):
            raise ValueError(f"polar grid out of range: {self}")

    @property
    def cells(self) -> int:
        """Number of cells."""
        return self.rings * self.sectors

    def cells_of(
        self, x: NDArray[np.floating], y: NDArray[np.floating]
    ) -> tuple[NDArray[np.intp], NDArray[np.int32]]:
        """Cells of (p,) coordinates.

        Returns:
            (k,) rows of the coordinates inside the grid, and their (k,) cells: ring * sectors + sector.
        """
        radius = np.sqrt(x * x + y * y)
        inside = np.flatnonzero(radius < self.max_range_m)
        if len(inside) < len(x):
            x, y, radius = x[inside], y[inside], radius[inside]
        radius *= np.float32(self.rings / self.max_range_m)
        ring = radius.astype(np.int32)
        np.minimum(ring, self.rings - 1, out=ring)  # a radius a hair below the end may round up
        turn = atan2_turns(y, x)
        turn *= np.float32(self.sectors)
        sector = np.floor(turn, out=turn).astype(np.int32)
        sector += (sector < 0) * np.int32(self.sectors)  # -0.5..0.5: the cell before 0 is the last
        np.minimum(sector, self.sectors - 1, out=sector)
        ring *= self.sectors
        ring += sector
        return inside, ring

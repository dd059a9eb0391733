"""The templates of a map: where each stands and what a scan there looks like (paper III.A)."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .occupancy import LayeredGrid


@dataclass(frozen=True)
class Templates:
    """n templates, all in the index's levelled frame, sensor upright with x along the frame's x.

    Attributes:
        position_m: (n, 3) float32 of the sensor.
        height_m: (n,) float32 of the sensor above its floor.
        angle_rad, ratio: (n,) float32, first principal axis and eigenvalue ratio.
        context: (n, rings, sectors) float16, PCA-SC.
        cnz: (n, rings) float32.
        occupancy: (n, ceil(rows * sectors / 8)) uint8, layered occupancy, packed bits.
    """

    position_m: NDArray[np.float32]
    height_m: NDArray[np.float32]
    angle_rad: NDArray[np.float32]
    ratio: NDArray[np.float32]
    context: NDArray[np.float16]
    cnz: NDArray[np.float32]
    occupancy: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.position_m)

    def layers(self, rows: NDArray[np.int64], grid: LayeredGrid) -> NDArray[np.uint8]:
        """Layered occupancy of the given templates, (k, layers * rings, sectors), 0 or 1."""
        bits = np.unpackbits(self.occupancy[rows], axis=1, count=grid.rows * grid.polar.sectors)
        return bits.reshape(len(rows), grid.rows, grid.polar.sectors)

    def save(self, directory: Path) -> None:
        for field in fields(self):
            np.save(directory / f"{field.name}.npy", getattr(self, field.name))

    @classmethod
    def load(cls, directory: Path) -> Templates:
        """Memory-mapped: replicas of one machine share the pages."""
        return cls(**{f.name: np.load(directory / f"{f.name}.npy", mmap_mode="r") for f in fields(cls)})

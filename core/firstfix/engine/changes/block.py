"""Block: all cells within reach of a sensor, to count in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...transform import Matrix
from .cells import CELL_M, keys_of

REACH_M = (
    25.0  # what lies further away is not counted: there a small error of the pose moves it to another cell
)
_CELLS_AROUND = int(np.ceil(REACH_M / CELL_M)) + 1
SIZE = 2 * _CELLS_AROUND + 1  # cells along an edge of a block


@dataclass(frozen=True)
class Block:
    """The cells around a sensor.

    Attributes:
        T_map_sensor: (4, 4).
        low: (3,) the first cell.
    """

    T_map_sensor: Matrix
    low: NDArray[np.int64]

    @classmethod
    def around(cls, T_map_sensor: Matrix) -> Block:
        """Block around a pose."""
        middle = np.floor(T_map_sensor[:3, 3] / CELL_M).astype(np.int64)
        return cls(T_map_sensor, middle - _CELLS_AROUND)

    @property
    def turn(self) -> NDArray[np.float32]:
        """(3, 3) from the sensor frame to cells."""
        return np.ascontiguousarray(self.T_map_sensor[:3, :3] / CELL_M, np.float32)

    @property
    def start(self) -> NDArray[np.float32]:
        """(3,) place of the sensor in the block, in cells."""
        return (self.T_map_sensor[:3, 3] / CELL_M - self.low).astype(np.float32)

    def keys(self, numbers: NDArray[np.int32]) -> NDArray[np.int64]:
        """Keys (n,) of cells by their (n,) numbers in the block. Both ascend."""
        inside = np.unravel_index(numbers, (SIZE,) * 3)
        return keys_of(np.stack(inside, axis=1) + self.low)

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
_SIZE = 2 * _CELLS_AROUND + 1


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

    def count(self, points: NDArray[np.float32]) -> NDArray[np.int64]:
        """Number of points in each cell.

        Args:
            points: (n, 3) in the sensor frame, within REACH_M.
        """
        start = (self.T_map_sensor[:3, 3] / CELL_M - self.low).astype(np.float32)
        turned = points @ (self.T_map_sensor[:3, :3].T / CELL_M).astype(np.float32)
        at = (turned + start).astype(np.int32)
        return np.bincount((at[:, 0] * _SIZE + at[:, 1]) * _SIZE + at[:, 2], minlength=_SIZE**3)

    def count_passing(
        self, directions: NDArray[np.float32], until_m: NDArray[np.float32]
    ) -> NDArray[np.int64]:
        """Number of rays that pass through each cell, about: some count twice.

        Args:
            directions: (n, 3) unit vectors in the sensor frame.
            until_m: (n,) length of each ray; none is longer than REACH_M.
        """
        steps = np.maximum(until_m / CELL_M, 0).astype(np.int64)
        ray = np.repeat(np.arange(len(steps)), steps)
        number = np.arange(len(ray)) - np.repeat(np.cumsum(steps) - steps, steps)
        at_m = ((number + 1) * CELL_M).astype(np.float32)
        return self.count(directions[ray] * at_m[:, None])

    def keys(self, chosen: NDArray[np.bool_]) -> NDArray[np.int64]:
        """Keys of the chosen cells, ascending."""
        inside = np.unravel_index(np.flatnonzero(chosen), (_SIZE,) * 3)
        return keys_of(np.stack(inside, axis=1) + self.low)

"""Range view: the ranges of a scan by direction. It needs NumPy only, for builder, service and robot."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from ..bit_exact.accelerated import accelerated
from ..bit_exact.atan2 import atan2_turns

CELL_DEG = 2.0
COLUMNS = round(360 / CELL_DEG)
ROWS = round(180 / CELL_DEG)
NEAREST_M = 0.3
ENOUGH = 7  # of a cell and its eight neighbours; fewer lie at the edge of the field of view or beside holes

_RADIANS_A_CELL = 2 * np.pi / COLUMNS


@dataclass(frozen=True)
class RangeView:
    """Ranges of one scan by direction, made once for all the poses at which it is checked.

    Attributes:
        returned: (cells,) whether there are returns in that direction and around it, in ENOUGH cells. Beside
            a hole nobody knows what a ray would have met. In a scan that is mostly holes: in that direction.
        least: (cells,) nearest range in and around the direction, metres.
    """

    returned: NDArray[np.bool_]
    least: NDArray[np.float32]

    @classmethod
    def of(cls, points: NDArray[np.float32]) -> RangeView:
        """Range view of points.

        Args:
            points: (n, 3) some thousand returns, sensor frame.
        """
        return cls.of_nearest(nearest_by_direction(points))

    @classmethod
    def of_nearest(cls, nearest: NDArray[np.float32]) -> RangeView:
        """Range view of (cells,) nearest ranges, infinite in directions without a return."""
        image = nearest.reshape(ROWS, COLUMNS)
        around = filled_around(np.isfinite(image))
        seen = np.bincount(around.ravel(), minlength=10)[1:].cumsum()  # by the cells around
        usual = 1 + int(np.searchsorted(seen, seen[-1] / 2))
        enough = ENOUGH if usual >= ENOUGH else 1
        return cls((around >= enough).ravel(), least_of_neighbours(image).ravel())


def filled_around(image: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Number of filled cells among each filled cell and its eight neighbours, else 0; columns wrap around."""
    one = image.view(np.uint8)
    across = one.copy()
    across[:, 1:] += one[:, :-1]
    across[:, :-1] += one[:, 1:]
    across[:, 0] += one[:, -1]
    across[:, -1] += one[:, 0]
    around = across.copy()
    around[1:] += across[:-1]
    around[:-1] += across[1:]
    around *= one
    return around


@accelerated
def nearest_by_direction(points: NDArray[np.float32]) -> NDArray[np.float32]:
    """Nearest range of (n, 3) points in each of (cells,) directions from the origin, inf without a point."""
    x, y, z = np.ascontiguousarray(points.T)
    distance = np.sqrt(x * x + y * y + z * z)
    image = np.full(ROWS * COLUMNS, np.inf, np.float32)
    far = distance > NEAREST_M
    np.minimum.at(image, cells_of(points)[far], distance[far])
    return image


def cells_of(points: NDArray[np.float32]) -> NDArray[np.int32]:
    """(n,) cell of ``nearest_by_direction`` in which each of (n, 3) points lies, seen from the origin."""
    x, y, z = np.ascontiguousarray(points.T)
    column = ((atan2_turns(y, x) + np.float32(0.5)) * np.float32(COLUMNS)).astype(np.int32)
    elevation = atan2_turns(z, np.sqrt(x * x + y * y))
    row = ((elevation + np.float32(0.25)) * np.float32(COLUMNS)).astype(np.int32)
    cells: NDArray[np.int32] = np.minimum(row, ROWS - 1) * COLUMNS + column % COLUMNS
    return cells


@cache
def directions() -> NDArray[np.float32]:
    """Unit vectors (cells, 3) through the middles of the cells of ``nearest_by_direction``, read-only."""
    azimuth = (np.arange(COLUMNS) + 0.5) * _RADIANS_A_CELL - np.pi
    elevation = ((np.arange(ROWS) + 0.5) * _RADIANS_A_CELL - np.pi / 2)[:, None]
    x, y = np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth)
    z = np.broadcast_to(np.sin(elevation), x.shape)
    through = np.stack([x, y, z], axis=-1).reshape(-1, 3).astype(np.float32)
    through.setflags(write=False)
    return through


@accelerated
def least_of_neighbours(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """Minimum of each cell and its eight neighbours; columns wrap around."""
    across = np.minimum(np.minimum(np.roll(image, 1, axis=1), np.roll(image, -1, axis=1)), image)
    least = across.copy()
    np.minimum(least[1:], across[:-1], out=least[1:])
    np.minimum(least[:-1], across[1:], out=least[:-1])
    return least

"""Range image in NumPy: the nearest point in each direction, at any resolution, and around each direction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix.bit_exact.atan2 import atan2_turns

ENOUGH = 3  # of a direction and its eight neighbours that have a return


@dataclass(frozen=True)
class RangeImage:
    """Ranges of points by direction from the sensor.

    Attributes:
        columns: directions around the sensor; there are half as many rows.
        nearest_m: (rows, columns) to the nearest point, inf where there is none.
        least_m, most_m: (rows, columns) least and largest of the finite ranges in and around each direction;
            inf and -inf where there is none.
        covered: (rows, columns) whether there are ENOUGH points around a direction, and on both of its sides:
            beyond the edge of the field of view, nobody knows what a ray would meet.
    """

    columns: int
    nearest_m: NDArray[np.float32]
    least_m: NDArray[np.float32]
    most_m: NDArray[np.float32]
    covered: NDArray[np.bool_]

    @classmethod
    def of(cls, points: NDArray[np.float32], columns: int) -> RangeImage:
        """Range image of (n, 3) points in the sensor frame."""
        flat_m = np.full(columns // 2 * columns, np.inf, np.float32)
        x, y, z = np.ascontiguousarray(points.T, np.float32)
        np.minimum.at(flat_m, _cells_of(points, columns), np.sqrt(x * x + y * y + z * z))
        nearest_m = flat_m.reshape(columns // 2, columns)
        is_filled = np.isfinite(nearest_m)
        return cls(
            columns,
            nearest_m,
            _around(nearest_m, np.minimum),
            _around(np.where(is_filled, nearest_m, np.float32(-np.inf)), np.maximum),
            _is_covered(is_filled),
        )

    def at(self, points: NDArray[np.float32]) -> NDArray[np.int32]:
        """(n,) places in the flat arrays of the directions of (n, 3) points."""
        return _cells_of(points, self.columns)


def _cells_of(points: NDArray[np.float32], columns: int) -> NDArray[np.int32]:
    x, y, z = np.ascontiguousarray(points.T, np.float32)
    across = np.sqrt(x * x + y * y)
    column = ((atan2_turns(y, x) + np.float32(0.5)) * np.float32(columns)).astype(np.int32) % columns
    row = ((atan2_turns(z, across) + np.float32(0.25)) * np.float32(columns)).astype(np.int32)
    cells: NDArray[np.int32] = np.minimum(row, columns // 2 - 1) * columns + column
    return cells


def _is_covered(is_filled: NDArray[np.bool_]) -> NDArray[np.bool_]:
    above, below = np.zeros((2, *is_filled.shape), bool)
    in_row = is_filled | np.roll(is_filled, 1, axis=1) | np.roll(is_filled, -1, axis=1)
    above[:-1], below[1:] = in_row[1:], in_row[:-1]
    in_column = _around(is_filled, np.logical_or, columns=False)
    beside = np.roll(in_column, 1, axis=1) & np.roll(in_column, -1, axis=1)
    enough = _around(is_filled.astype(np.uint8), np.add) >= ENOUGH
    covered: NDArray[np.bool_] = (in_row | (above & below)) & (in_column | beside) & enough
    return covered


def _around(image: NDArray[Any], combine: np.ufunc, *, columns: bool = True) -> NDArray[Any]:
    """Each direction combined with its eight neighbours; columns wrap around.

    Args:
        columns: False: combined with those above and below alone.
    """
    across = image
    if columns:
        across = combine(combine(np.roll(image, 1, axis=1), np.roll(image, -1, axis=1)), image)
    found: NDArray[Any] = across.copy()
    found[1:] = combine(found[1:], across[:-1])
    found[:-1] = combine(found[:-1], across[1:])
    return found

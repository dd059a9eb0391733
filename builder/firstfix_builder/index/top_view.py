"""The map from above, as an image: to draw a dot for each point of a map takes seconds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

PIXELS = 900  # along the longer side
_OPACITY = 0.45  # of one point: walls, with many points in a pixel, stand out


@dataclass(frozen=True)
class TopView:
    """Image of a map; the first row is the southern one, the first column the western one.

    Attributes:
        opacity: (rows, columns) 0 without a point, nearly 1 with many.
        height_m: (rows, columns) mean of the points in each pixel, 0 without a point.
        extent_m: west, east, south and north end.
    """

    opacity: NDArray[np.float64]
    height_m: NDArray[np.float64]
    extent_m: tuple[float, float, float, float]

    @classmethod
    def of(cls, points: NDArray[np.floating]) -> TopView:
        """View of (n, 3) points, one or more."""
        low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
        pixel_m = max(float((high - low).max()) / PIXELS, 1e-3)
        column, row = ((points[:, :2] - low) / pixel_m).astype(np.int64).T
        columns, rows = int(column.max()) + 1, int(row.max()) + 1
        pixel = row * columns + column
        count = np.bincount(pixel, minlength=rows * columns).astype(np.float64)
        height_m = np.bincount(pixel, points[:, 2], minlength=rows * columns) / np.maximum(count, 1)
        opacity: NDArray[np.float64] = 1 - np.power(1 - _OPACITY, count)
        west, south = (float(corner) for corner in low)
        return cls(
            opacity.reshape(rows, columns),
            height_m.reshape(rows, columns),
            (west, west + columns * pixel_m, south, south + rows * pixel_m),
        )

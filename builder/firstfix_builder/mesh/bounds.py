"""Bounds of points, column by column: NumPy reduces rows of three floating numbers ten times as slowly."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def bounds(points: NDArray[np.floating]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The least and the largest coordinates (k,) of (n, k) points, n at least 1."""
    ends = np.array([(column.min(), column.max()) for column in points.T], np.float64)
    return ends[:, 0], ends[:, 1]


def extent(points: NDArray[np.floating]) -> NDArray[np.float64]:
    """The width (k,) of (n, k) points along each axis."""
    low, high = bounds(points)
    return high - low


def in_all(holds: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Whether (n, 3) conditions hold in all columns of each row."""
    return holds[:, 0] & holds[:, 1] & holds[:, 2]

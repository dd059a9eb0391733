"""Information that comes from surfaces which truly face a direction (docs/method.md section 7)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_NOISE_M = 0.01  # standard deviation of a scan point's distance from the map, at least
_PARTS = (slice(0, 3), slice(3, 6))  # of the information: turns, shifts


def principal_axes(information: NDArray[np.float64]) -> NDArray[np.float64]:
    """Principal axes (2, 3, 3) of (6, 6) information, column by column: of turns, then of shifts."""
    return np.linalg.eigh(np.stack([information[part, part] for part in _PARTS]))[1]


def faced_information(
    information: NDArray[np.float64],
    axes: NDArray[np.float64],
    told: NDArray[np.float64],
    weights: float,
    squares: float,
) -> NDArray[np.float64]:
    """Information (6, 6) less what walls seem to tell of shifts along them, and of turns about their normal.

    Normals scatter, so the walls of a bare corridor seem to tell of the shift along it, and the more points
    there are the surer. What a principal direction of shifts, or of turns, has is cut to the share that comes
    from the points which face it, with the variance of their own distances.

    Args:
        information: (6, 6) over rotation then translation.
        axes: (2, 3, 3) its principal axes.
        told, weights, squares: by the kernel ``native.told`` for these axes.
    """
    all_told, faced_told, faced_weights, faced_squares = told  # (2, 3) each
    all_told = all_told / _variance(squares, weights)
    faced_told = faced_told / _variance(faced_squares, faced_weights)
    share = np.minimum(faced_told / np.where(all_told > 0, all_told, 1.0), 1.0)
    root = np.zeros((6, 6))
    for part, of_part, kept in zip(_PARTS, axes, np.sqrt(share), strict=True):
        root[part, part] = (of_part * kept) @ of_part.T
    return root @ information @ root


def _variance(
    squares: NDArray[np.float64] | float, weights: NDArray[np.float64] | float
) -> NDArray[np.float64]:
    """Variances of distances, from the sums of their weighted squares and of their weights."""
    return squares / np.maximum(weights, 1.0) + _NOISE_M**2

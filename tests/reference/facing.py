"""Information of surfaces that truly face a direction, in NumPy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firstfix.engine.registration.surface_grid import SurfaceGrid

FACES = 0.3  # sine
_NOISE_M = 0.01  # standard deviation of a scan point's distance from the map, at least
_PARTS = (slice(0, 3), slice(3, 6))  # of the information: turns, shifts


def told(
    arms: NDArray[np.floating],
    normals: NDArray[np.floating],
    off_m: NDArray[np.floating],
    axes: NDArray[np.float64],
    reach_m: float,
) -> tuple[NDArray[np.float64], float, float]:
    """Sums along principal directions, of turns then shifts, with all weights and squared distances.

    Args:
        arms, normals: (n, 3) of pairs.
        off_m: (n,) their distances.
    """
    weights = np.maximum(1 - (off_m / reach_m) ** 2, 0) ** 2
    squares = np.sum(arms * arms, axis=1)[:, None]
    sums = np.empty((4, 2, 3))
    for part, is_turn in enumerate((True, False)):
        told2 = ((np.cross(arms, normals) if is_turn else normals) @ axes[part]) ** 2  # (n, 3)
        lever2 = squares - (arms @ axes[part]) ** 2 if is_turn else 1.0
        faced = weights[:, None] * (told2 > FACES**2 * lever2)
        sums[:, part] = weights @ told2, (faced * told2).sum(axis=0), faced.sum(axis=0), off_m**2 @ faced
    return sums, float(weights.sum()), float(weights @ off_m**2)


def told_in(
    grid: SurfaceGrid,
    points: NDArray[np.float32],
    T_level_sensor: NDArray[np.float64],
    axes: NDArray[np.float64],
    reach_m: float,
) -> tuple[NDArray[np.float64], float, float]:
    """The same of a scan's points with the planes of a grid."""
    arms = points @ T_level_sensor[:3, :3].T.astype(np.float32)
    at = arms + (T_level_sensor[:3, 3] - grid.corner).astype(np.float32)
    row = grid.nearest(at)
    planes, arms, at = grid.planes[row[row >= 0]], arms[row >= 0], at[row >= 0]
    off_m = planes[:, 3] - np.sum(at * planes[:, :3], axis=1)
    return told(arms, planes[:, :3], off_m, axes, reach_m)


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
        told, weights, squares: sums (``told``) for these axes.
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

"""Sums of the information of surfaces along principal directions, in NumPy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firstfix.engine.registration.surface_grid import SurfaceGrid

FACES = 0.3  # sine


def told(
    arms: NDArray[np.floating],
    normals: NDArray[np.floating],
    off_m: NDArray[np.floating],
    axes: NDArray[np.float64],
    reach_m: float,
) -> tuple[NDArray[np.float64], float, float]:
    """What ``native.told`` returns, from the (n, 3) arms and normals of pairs and their (n,) distances."""
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

"""Information that comes from surfaces which truly face a direction (docs/method.md section 7)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# Sine. Normals of recorded maps scatter by 2 to 5 degrees. A surface that faces a direction by over 17
# degrees is no wall along it.
_FACES = 0.3
_NOISE_M = 0.01  # standard deviation of a scan point's distance from the map, at least


def faced_information(
    information: NDArray[np.float64],
    arms: NDArray[np.floating],
    normals: NDArray[np.floating],
    off_m: NDArray[np.floating],
    reach_m: float,
) -> NDArray[np.float64]:
    """Information (6, 6) less what walls seem to tell of shifts along them, and of turns about their normal.

    Normals scatter, so the walls of a bare corridor seem to tell of the shift along it, and the more points
    there are the surer. What a principal direction of shifts, or of turns, has is cut to the share that comes
    from the points which face it, with the variance of their own distances.

    Args:
        information: (6, 6) over rotation then translation.
        arms: (n, 3) scan points from the sensor, along the level axes.
        normals: (n, 3) of the map's surface at each.
        off_m: (n,) distances from it.
        reach_m: a pair further apart has no weight.
    """
    weights = np.maximum(1 - (off_m / reach_m) ** 2, 0) ** 2
    squares = np.sum(arms * arms, axis=1)[:, None]
    root = np.zeros((6, 6))
    for part, is_turn in ((slice(0, 3), True), (slice(3, 6), False)):
        axes = np.linalg.eigh(information[part, part])[1]
        told2 = ((np.cross(arms, normals) if is_turn else normals) @ axes) ** 2  # (n, 3)
        lever2 = squares - (arms @ axes) ** 2 if is_turn else 1.0
        of_facing = weights[:, None] * (told2 > _FACES**2 * lever2)
        all_told = weights @ told2 / _variance(weights[:, None], off_m)
        facing_told = (of_facing * told2).sum(axis=0) / _variance(of_facing, off_m)
        share = np.minimum(facing_told / np.where(all_told > 0, all_told, 1.0), 1.0)
        root[part, part] = (axes * np.sqrt(share)) @ axes.T
    return root @ information @ root


def _variance(weights: NDArray[np.floating], off_m: NDArray[np.floating]) -> NDArray[np.floating]:
    """Variances (k,) of the distances under each column of (n, k) weights."""
    return (off_m**2 @ weights) / np.maximum(weights.sum(axis=0), 1.0) + _NOISE_M**2

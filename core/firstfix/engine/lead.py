"""The lead of one place over another, sector by sector: is it all around, or made by one thing?

A scan fits two places that look alike a little differently. What moved, or was never mapped, stands in one
direction, so a lead that it makes comes from there. The true place leads all around.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .registration.align import MapSurface

_SECTORS = 16  # of azimuth, each in a near and a far part
_MIN_ERROR = 2e-3  # of the mean lead: two places that fit nearly perfectly lead by nothing


def lead_t(
    surface: MapSurface, placed_m: Sequence[NDArray[np.float32]], sensor_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Mean lead in alignment score over its standard error, which the differences between sectors tell.

    Args:
        surface: of the map.
        placed_m: (n, 3) points of one scan, in the map's level frame, as they lie at the first place, and at
            k others.
        sensor_m: (3,) of the sensor at the first place.

    Returns:
        (k,) t of the lead over each of the others; negative where the other one leads.
    """
    away_m = placed_m[0] - sensor_m.astype(np.float32)
    turn = np.arctan2(away_m[:, 1], away_m[:, 0]) / (2 * np.pi) + 0.5
    range_m = np.linalg.norm(away_m, axis=1)
    part = (turn * _SECTORS).astype(int) % _SECTORS * 2 + (range_m > np.median(range_m))
    count = np.bincount(part, minlength=2 * _SECTORS)
    weight, filled = count / count.sum(), np.maximum(count, 1)
    own, *others = (_scores(surface, points) for points in placed_m)
    found = []
    for other in others:
        lead = np.bincount(part, own - other, 2 * _SECTORS) / filled
        mean = weight @ lead
        found.append(mean / (np.sqrt(weight**2 @ (lead - mean) ** 2) + _MIN_ERROR))
    return np.array(found)


def _scores(surface: MapSurface, points: NDArray[np.float32]) -> NDArray[np.float64]:
    """(n,) how well points fit, 0..1: 1 on a plane of the map, 0 from ``inlier_distance_m`` on."""
    grid = surface.fine
    at_m = np.ascontiguousarray(points - grid.corner, np.float32)
    row = grid.nearest(at_m)
    plane = grid.planes[np.maximum(row, 0)]
    off_m = np.einsum("ij,ij->i", plane[:, :3], at_m) - plane[:, 3]
    score = np.maximum(0, 1 - (off_m / surface.config.inlier_distance_m) ** 2)
    return np.where(row >= 0, score, 0).astype(np.float64)

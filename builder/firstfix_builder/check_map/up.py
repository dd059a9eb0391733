"""Whether a map's floor is level: the largest flat surface of a map whose y points up stands upright."""

from __future__ import annotations

import numpy as np

from firstfix.engine.registration.surface import Surface
from firstfix.findings.finding import Finding
from firstfix.findings.map_kinds import MAP_NOT_LEVEL

VOXEL_M = 0.3
MAX_POINTS = 120_000
ACROSS_DEG = 10.0
SLAB_M = 0.5
CLEARLY = 2.0  # times as much surface must lie across y: a corridor has more wall than floor
_LEAST_SHARE = 0.02


def check_up(surface: Surface) -> Finding | None:
    """Finding of a map whose floor lies across y.

    Two figures must agree: how much surface lies across an axis, and how much of it in one slab.
    """
    if not len(surface):
        return None
    across = np.abs(surface.normals) > np.cos(np.radians(ACROSS_DEG))  # (n, 3)
    share = across.mean(axis=0)
    slab = np.array([_largest_slab(surface.points[across[:, k], k]) for k in range(3)]) / len(surface)
    if slab[1] < _LEAST_SHARE or share[1] < CLEARLY * share[2] or slab[1] < CLEARLY * slab[2]:
        return None
    return MAP_NOT_LEVEL.found({"level_y_share": float(share[1]), "level_z_share": float(share[2])})


def _largest_slab(heights_m: np.ndarray) -> int:
    if not len(heights_m):
        return 0
    return int(np.bincount(np.floor((heights_m - heights_m.min()) / SLAB_M).astype(np.int64)).max())

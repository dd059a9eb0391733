"""Whether a map's floor is level: the largest flat surface of a map whose y points up stands upright."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firstfix.engine.registration.surface import Surface
from firstfix.findings.finding import Finding
from firstfix.findings.map_kinds import MAP_NOT_LEVEL

VOXEL_M = 0.3
MAX_POINTS = 120_000
ACROSS_DEG = 10.0
SLAB_M = 0.5
CLEARLY = 2.0  # times as much surface must lie across y: a corridor has more wall than floor
WIDE_M, FLAT_SHARE = 5.0, 0.25  # extents of a way along two axes, and of the smaller of these along the third
_MIN_SHARE = 0.02


def check_up(surface: Surface, poses: NDArray[np.float64] | None = None) -> Finding | None:
    """Finding of a map whose floor lies across y.

    Two figures must agree: how much surface lies across an axis, and how much of it in one slab. Where a
    trajectory is wide along x and z and flat along y, a robot drove there, and more of both across y will do:
    rooms have more wall than floor.

    Args:
        poses: (m, 4, 4) T_map_sensor of the mapping run.
    """
    if not len(surface):
        return None
    across = np.abs(surface.normals) > np.cos(np.radians(ACROSS_DEG))  # (n, 3)
    share = across.mean(axis=0)
    slab = np.array([_largest_slab(surface.points[across[:, k], k]) for k in range(3)]) / len(surface)
    least = 1.0 if poses is not None and _is_flat_along_y(poses) else CLEARLY
    if slab[1] < _MIN_SHARE or share[1] < least * share[2] or slab[1] < least * slab[2]:
        return None
    return MAP_NOT_LEVEL.found({"level_y_share": float(share[1]), "level_z_share": float(share[2])})


def _is_flat_along_y(poses: NDArray[np.float64]) -> bool:
    """Whether a way is wide along x and z: not straight, and no way of a robot if z points up."""
    x_m, y_m, z_m = np.ptp(poses[:, :3, 3], axis=0)
    return bool(min(x_m, z_m) >= WIDE_M and y_m < FLAT_SHARE * min(x_m, z_m))


def _largest_slab(heights_m: np.ndarray) -> int:
    if not len(heights_m):
        return 0
    return int(np.bincount(np.floor((heights_m - heights_m.min()) / SLAB_M).astype(np.int64)).max())

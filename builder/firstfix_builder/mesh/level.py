"""Finds the up direction of a map: SLAM maps are tilted as their first scan was."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firstfix.engine.registration.surface import Surface
from firstfix.errors import BuildFailed
from firstfix.scan.levelling import estimate_up, refined_up
from firstfix.scan.reduction import at_most, voxel_means
from firstfix.transform import Matrix, make_transform, rotation_between

from .bounds import in_all

VOXEL_M = 0.3
MAX_LEAN_DEG = 10.0  # a larger lean is a property of the place, not of the frame
MIN_LEAN_DEG = 0.2
VOTERS = 500_000  # a thousand, as for a scan, are a sixth of a degree apart from another thousand
LEANING_DEG = 5.0
LEVEL_SHARE = 0.05  # of the surface
_LEVEL = np.cos(np.radians(3.0))
STEP = 0.002  # of the up vector, a tenth of a degree: a change of a part must not turn the whole map


def level_frame(points: NDArray[np.float64]) -> Matrix:
    """T_map_level of (n, 3) points: it has the map's origin, and its z axis is the up of the map's surfaces.

    Raises:
        BuildFailed: the points are too far apart.
    """
    up = _up(_normals(points))
    lean_deg = np.degrees(np.arccos(np.clip(up[2], -1, 1)))
    if not MIN_LEAN_DEG < lean_deg < MAX_LEAN_DEG:
        return np.eye(4)
    return _frame_of(up)


def leaning_frame(points: NDArray[np.float64]) -> Matrix:
    """T_map_level as ``level_frame`` gives it, of a map that may lean as its sensor did, by up to 35 degrees.

    The identity, if it does not lean by over 5 degrees, or few surfaces would be level.

    Raises:
        BuildFailed: the points are too far apart.
    """
    normals = _normals(points)
    up = _up(normals)
    level, level_before = (float((np.abs(normals @ axis) > _LEVEL).mean()) for axis in (up, [0.0, 0.0, 1.0]))
    lean_deg = np.degrees(np.arccos(np.clip(up[2], -1, 1)))
    if lean_deg < LEANING_DEG or level < max(LEVEL_SHARE, 2 * level_before):
        return np.eye(4)
    return _frame_of(up)


def _normals(points: NDArray[np.float64]) -> NDArray[np.floating]:
    is_finite = np.isfinite(points)
    try:
        thinned = voxel_means(points if is_finite.all() else points[in_all(is_finite)], VOXEL_M)
    except ValueError:
        raise BuildFailed(f"the map is too large for voxels of {VOXEL_M} m") from None
    return Surface.around(thinned).normals


def _up(normals: NDArray[np.floating]) -> NDArray[np.float64]:
    return refined_up(at_most(normals, VOTERS), estimate_up(normals))


def _frame_of(up: NDArray[np.float64]) -> Matrix:
    R_level_map = rotation_between(np.round(up / STEP) * STEP, [0.0, 0.0, 1.0])
    return make_transform(R_level_map.T, np.zeros(3))

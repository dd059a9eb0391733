"""Finds the up direction of a map: SLAM maps are tilted as their first scan was."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firstfix.engine.registration.surface import Surface
from firstfix.errors import BuildFailed
from firstfix.scan.levelling import estimate_up, refined_up
from firstfix.scan.reduction import at_most, voxel_means
from firstfix.transform import Matrix, make_transform, rotation_between

VOXEL_M = 0.3
MAX_LEAN_DEG = 10.0  # a larger lean is a property of the place, not of the frame
MIN_LEAN_DEG = 0.2
VOTERS = 500_000  # a thousand, as for a scan, are a sixth of a degree apart from another thousand
STEP = 0.002  # of the up vector, a tenth of a degree: a change of a part must not turn the whole map


def level_frame(points: NDArray[np.float64]) -> Matrix:
    """T_map_level of (n, 3) points: it has the map's origin, and its z axis is the up of the map's surfaces.

    Raises:
        BuildFailed: the points are too far apart.
    """
    try:
        thinned = voxel_means(points[np.isfinite(points).all(axis=1)], VOXEL_M)
    except ValueError:
        raise BuildFailed(f"the map is too large for voxels of {VOXEL_M} m") from None
    normals = Surface.around(thinned).normals
    up = refined_up(at_most(normals, VOTERS), estimate_up(normals))
    lean_deg = np.degrees(np.arccos(np.clip(up[2], -1, 1)))
    if not MIN_LEAN_DEG < lean_deg < MAX_LEAN_DEG:
        return np.eye(4)
    R_level_map = rotation_between(np.round(up / STEP) * STEP, [0.0, 0.0, 1.0])
    return make_transform(R_level_map.T, np.zeros(3))

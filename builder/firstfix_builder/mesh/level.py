"""Finds the up direction of a map: SLAM maps are tilted as their first scan was."""

from __future__ import annotations

import numpy as np
import small_gicp
from numpy.typing import NDArray

from firstfix.scan.levelling import estimate_up
from firstfix.transform import Matrix, make_transform, rotation_between

VOXEL_M = 0.3
MAX_LEAN_DEG = 10.0  # further off, it is the place that is odd and not the frame
MIN_LEAN_DEG = 0.2


def level_frame(points: NDArray[np.float64]) -> Matrix:
    """T_map_level: the frame with the map's origin whose z is the up of its surfaces."""
    thinned = small_gicp.voxelgrid_sampling(points, VOXEL_M)
    small_gicp.estimate_normals_covariances(thinned, small_gicp.KdTree(thinned), 10)
    up = estimate_up(thinned.normals()[:, :3])
    lean_deg = np.degrees(np.arccos(np.clip(up[2], -1, 1)))
    if not MIN_LEAN_DEG < lean_deg < MAX_LEAN_DEG:
        return np.eye(4)
    # rounded: the digest of a version must not hang on the last bit of an eigenvector
    R_level_map = rotation_between(np.round(up, 9), [0.0, 0.0, 1.0])
    return make_transform(R_level_map.T, np.zeros(3))

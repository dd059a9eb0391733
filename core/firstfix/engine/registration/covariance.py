"""Covariance of an answered pose, from the information of its alignment (docs/method.md section 7)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...transform import Matrix
from ..config import RegistrationConfig

# Neighbouring pairs share the errors of the map and of the surface model, so one pair in this many counts as
# an independent observation. With this number the errors on real maps agree with the covariance
# (docs/method.md section 7); in simulation, where the map has no error, they are smaller.
_PAIRS_PER_OBSERVATION = 20.0
_FLOOR_DEG = 0.02


def pose_covariance(
    information: NDArray[np.float64], T_map_level: Matrix, config: RegistrationConfig
) -> NDArray[np.float64]:
    """Covariance (6, 6) over x, y, z, rotX, rotY, rotZ about the map's axes, in m and rad.

    A direction that the scan does not constrain (along a corridor) has almost no information, and so a large
    variance. The variance never falls below a floor that the map's resolution sets.

    Args:
        information: (6, 6) over rotation then translation, along the level axes.
    """
    values, vectors = np.linalg.eigh((information + information.T) / 2)
    values = np.maximum(values / _PAIRS_PER_OBSERVATION, 1e-4)  # a standard deviation of 100 m or rad at most
    in_level = (vectors / values) @ vectors.T
    R = T_map_level[:3, :3]
    to_map = np.zeros((6, 6))
    to_map[:3, 3:] = R  # translation comes first in the answer, last in the registration
    to_map[3:, :3] = R
    covariance: NDArray[np.float64] = to_map @ in_level @ to_map.T
    floor_m = config.map_voxel_m / 20
    covariance[np.diag_indices(6)] += np.repeat([floor_m**2, np.radians(_FLOOR_DEG) ** 2], 3)
    return covariance

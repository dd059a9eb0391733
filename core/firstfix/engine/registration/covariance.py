"""Covariance of a fix, from the information matrix of its registration."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...transform import Matrix
from ..config import RegistrationConfig

# Neighbouring pairs share the errors of the map and of the model of a surface: one in this many counts as
# independent evidence. By this the errors on real maps are as large as the covariance says (docs/method.md);
# in simulation, where the map has no error, they are smaller.
_PAIRS_PER_OBSERVATION = 20.0
_FLOOR_DEG = 0.02


def pose_covariance(
    information: NDArray[np.float64], T_map_level: Matrix, config: RegistrationConfig
) -> NDArray[np.float64]:
    """(6, 6) over x, y, z, rotX, rotY, rotZ about the map's axes, in m and rad.

    Args:
        information: (6, 6) over rotation then translation, along the level axes.

    A direction that the scan does not fix (along a corridor) has almost no information, and so a
    large variance. It never falls below what the map's own resolution allows.
    """
    values, vectors = np.linalg.eigh((information + information.T) / 2)
    values = np.maximum(values / _PAIRS_PER_OBSERVATION, 1e-4)  # at most 100 m or rad: known to be unknown
    in_level = (vectors / values) @ vectors.T
    R = T_map_level[:3, :3]
    to_map = np.zeros((6, 6))
    to_map[:3, 3:] = R  # translation comes first in the answer, last in the registration
    to_map[3:, :3] = R
    covariance: NDArray[np.float64] = to_map @ in_level @ to_map.T
    floor_m = config.map_voxel_m / 20
    covariance[np.diag_indices(6)] += np.repeat([floor_m**2, np.radians(_FLOOR_DEG) ** 2], 3)
    return covariance

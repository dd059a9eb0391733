"""Covariance of an answered pose, from the information of its alignment (docs/method.md section 7)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...transform import Matrix
from ..config import RegistrationConfig

# Neighbouring pairs share the errors of the map and of the surface model, so one pair in this many counts as
# an independent observation.
_PAIRS_PER_OBSERVATION = 20.0
# Normals scatter by some degrees, so a bare wall seems to tell a little of the shift along it. This share
# of all that the pairs tell of shifts, or of turns, is taken for scatter. A bare corridor in simulation has
# .0003 to .0009, and the normals of recorded scans and maps scatter twice as much. One pair in a hundred that
# faces along the corridor still counts.
_SHARE_OF_SCATTER = 0.003
# Known without the scan: twice what counts as the right place (1 m, 10 degrees), which is what an answer's
# probability is about. A place further off along a free direction would tie, and nothing would be localized.
_PLACE_M, _PLACE_DEG = 2.0, 20.0
_FLOOR_DEG = 0.02


def pose_covariance(
    information: NDArray[np.float64], T_map_level: Matrix, config: RegistrationConfig
) -> NDArray[np.float64]:
    """Covariance (6, 6) over x, y, z, rotX, rotY, rotZ about the map's axes, in m and rad (equation 7.3).

    A direction that the scan does not constrain (along a corridor) keeps the variance of the place, however
    many points there are. The variance never falls below a floor that the map's resolution sets.

    Args:
        information: (6, 6) over rotation then translation, along the level axes.
    """
    place = np.repeat([np.radians(_PLACE_DEG), _PLACE_M], 3)
    in_level = np.linalg.inv(_without_scatter(information) / _PAIRS_PER_OBSERVATION + np.diag(place**-2))
    R = T_map_level[:3, :3]
    to_map = np.zeros((6, 6))
    to_map[:3, 3:] = R  # translation comes first in the answer, last in the registration
    to_map[3:, :3] = R
    covariance: NDArray[np.float64] = to_map @ (in_level + in_level.T) @ to_map.T / 2
    floor_m = config.map_voxel_m / 10
    covariance[np.diag_indices(6)] += np.repeat([floor_m**2, np.radians(_FLOOR_DEG) ** 2], 3)
    return covariance


def _without_scatter(information: NDArray[np.float64]) -> NDArray[np.float64]:
    """Information (6, 6) less what the scatter of normals alone would give; never negative."""
    scatter = _SHARE_OF_SCATTER * np.repeat([information[:3, :3].trace(), information[3:, 3:].trace()], 3)
    scale = np.sqrt(np.where(scatter > 0, scatter, 1.0))
    scaled = information / np.outer(scale, scale)
    times_scatter, vectors = np.linalg.eigh((scaled + scaled.T) / 2)
    beyond = (vectors * np.maximum(times_scatter - 1, 0)) @ vectors.T
    return np.outer(scale, scale) * beyond

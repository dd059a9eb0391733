"""Covariance of an answered pose, and its free directions, in NumPy."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from firstfix.answer.free_direction import FreeDirection, Motion
from firstfix.engine.config import RegistrationConfig
from firstfix.native import FREE_M, FREE_RAD
from firstfix.transform import Matrix

# Neighbouring pairs share the errors of the map and of the surface model, so one pair in this many counts as
# an independent observation.
_PAIRS_PER_OBSERVATION = 20.0
# A few normals at edges face a free direction by chance. This share of all that the pairs tell of shifts, or
# of turns, is taken for chance. Bare corridors and walls in simulation have up to .00006. A corridor whose
# doors stand 6 cm proud has .0004 to .0009, and scans are right along it to 2 cm.
_SHARE_BY_CHANCE = 0.0001
# Known without the scan: twice what counts as the right place (1 m, 10 degrees), which is what an answer's
# probability is about. A place further off along a free direction would tie, and nothing would be localized.
_PLACE_M, _PLACE_DEG = 2.0, 20.0
# The map's own error, which no number of pairs averages out. Chosen by the hall and the yard
# (lab/docs/experiments.md): not shown on other recorded places.
_FLOOR_OF_VOXEL, _FLOOR_DEG = 1 / 15, 0.02
_PLACE_INFORMATION = np.diag(np.repeat([np.radians(_PLACE_DEG), _PLACE_M], 3) ** -2)


def pose_covariance(
    information: NDArray[np.float64], T_map_level: Matrix, config: RegistrationConfig
) -> NDArray[np.float64]:
    """Covariance (6, 6) over x, y, z, rotX, rotY, rotZ about the map's axes, in m and rad (equation 7.3).

    A direction that the scan does not constrain (along a corridor) keeps the variance of the place, however
    many points there are. The variance never falls below a floor that the map's resolution sets.

    Args:
        information: (6, 6) over rotation then translation, along the level axes (``faced_information``).
    """
    in_level = np.linalg.inv(_beyond_chance(information) / _PAIRS_PER_OBSERVATION + _PLACE_INFORMATION)
    R = T_map_level[:3, :3]
    to_map = np.zeros((6, 6))
    to_map[:3, 3:] = R  # translation comes first in the answer, last in the registration
    to_map[3:, :3] = R
    in_map = to_map @ in_level @ to_map.T
    covariance: NDArray[np.float64] = (in_map + in_map.T) / 2  # equal to the last bit on both sides
    floor_m = config.map_voxel_m * _FLOOR_OF_VOXEL
    covariance.flat[::7] += np.repeat([floor_m**2, np.radians(_FLOOR_DEG) ** 2], 3)
    return covariance


def _beyond_chance(information: NDArray[np.float64]) -> NDArray[np.float64]:
    """Information (6, 6) less what normals tell by chance; never negative."""
    by_chance = _SHARE_BY_CHANCE * np.repeat([information[:3, :3].trace(), information[3:, 3:].trace()], 3)
    scale = np.sqrt(np.where(by_chance > 0, by_chance, 1.0))
    scaled = information / np.outer(scale, scale)
    times, vectors = np.linalg.eigh((scaled + scaled.T) / 2)
    beyond = (vectors * np.maximum(times - 1, 0)) @ vectors.T
    return np.outer(scale, scale) * beyond


def free_directions(covariance: NDArray[np.float64]) -> tuple[FreeDirection, ...]:
    """Directions whose standard deviation is above FREE_M or FREE_RAD (docs/method.md section 7).

    Args:
        covariance: (6, 6) over x, y, z, rotX, rotY, rotZ about the map's axes, in m and rad.

    Returns:
        Shifts before turns, of each the least certain first. Those of a kind are at right angles.
    """
    parts = (Motion.TRANSLATION, slice(0, 3), FREE_M), (Motion.ROTATION, slice(3, 6), FREE_RAD)
    found = []
    for motion, part, limit in parts:
        if covariance[part, part].trace() < limit**2:  # no variance is above their sum
            continue
        variances, vectors = np.linalg.eigh(covariance[part, part])
        for variance, direction in zip(variances[::-1].tolist(), vectors.T[::-1], strict=True):
            if variance > limit**2:
                sign = np.sign(direction[np.abs(direction).argmax()])
                found.append(FreeDirection(motion, sign * direction, math.sqrt(variance)))
    return tuple(found)

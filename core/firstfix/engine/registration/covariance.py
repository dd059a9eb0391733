"""Covariance of an answered pose, and the directions in which the pose is hardly fixed.

The kernels are in ``native/include/firstfix/registration/covariance.hpp``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ... import native
from ...answer.free_direction import FreeDirection, Motion
from ...transform import Matrix
from ..config import RegistrationConfig


def pose_covariance(
    information: NDArray[np.float64], T_map_level: Matrix, config: RegistrationConfig
) -> NDArray[np.float64]:
    """Covariance (6, 6) over x, y, z, rotX, rotY, rotZ about the map's axes, in m and rad (equation 7.3).

    A direction that the scan does not constrain (along a corridor) keeps the variance of the place, however
    many points there are. The variance never falls below a floor that the map's resolution sets.

    Args:
        information: (6, 6) over rotation then translation, along the level axes
            (``MapSurface.faced_information``).
    """
    return native.pose_covariance(information, T_map_level, config.map_voxel_m)


def free_directions(covariance: NDArray[np.float64]) -> tuple[FreeDirection, ...]:
    """Directions of a standard deviation above ``native.FREE_M`` or ``FREE_RAD`` (docs/method.md section 7).

    Args:
        covariance: (6, 6) over x, y, z, rotX, rotY, rotZ about the map's axes, in m and rad.

    Returns:
        Shifts before turns, of each the least certain first. Those of a kind are at right angles.
    """
    return tuple(
        FreeDirection(Motion.ROTATION if is_turn else Motion.TRANSLATION, direction, sigma)
        for is_turn, direction, sigma in native.free_axes(covariance)
    )

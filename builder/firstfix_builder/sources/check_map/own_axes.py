"""A map's own axes in the plane: what is measured along them does not depend on how the map is turned."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firstfix.bit_exact.sample import rows_by_chance
from firstfix.transform import Matrix, make_transform, rotation_z

_SAMPLED_POINTS = 100_000


def own_axes(points: NDArray[np.float64]) -> Matrix:
    """``T_own_map`` (4, 4): the origin in the middle of (n, 3) points, x along their longest extent.

    Of the two directions of x it is the one in which more lies far away. z stays.
    """
    sample = points[rows_by_chance(len(points), _SAMPLED_POINTS)]
    middle = sample.mean(axis=0)
    from_middle = sample[:, :2] - middle[:2]
    x_axis = np.linalg.eigh(from_middle.T @ from_middle)[1][:, 1]
    if np.sum((from_middle @ x_axis) ** 3) < 0:
        x_axis = -x_axis
    R = rotation_z(-float(np.arctan2(x_axis[1], x_axis[0])))
    return make_transform(R, -R @ middle)

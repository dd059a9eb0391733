"""Whether a trajectory is one, and of this map: sensors move in free space, inside the map."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from firstfix.bit_exact.sample import rows_by_chance
from firstfix.findings.finding import Finding
from firstfix.findings.map_kinds import TRAJECTORY_ELSEWHERE, TRAJECTORY_IS_CLOUD, TRAJECTORY_LEFT_OUT

from ...mesh.bounds import bounds

TOUCHING_M = 0.15  # no sensor is so near to a surface all the way
MAX_TOUCHING = 0.6
MARGIN_M = 20.0
MAX_OUTSIDE = 0.5
_SAMPLED_POSES = 500
_MIN_POSES = 10  # of fewer, chance decides


def check_trajectory(
    points: NDArray[np.float64], poses: NDArray[np.float64], *, is_given: bool
) -> Finding | None:
    """Finding of (m, 4, 4) poses that are no trajectory of the map with (n, 3) points, in one frame.

    Args:
        is_given: by the user. Poses that came with the map refuse no map: they are left out of it.
    """
    at = poses[rows_by_chance(len(poses), _SAMPLED_POSES), :3, 3]
    low, high = bounds(points)
    outside = float(((at < low - MARGIN_M) | (at > high + MARGIN_M)).any(axis=1).mean())
    if outside > MAX_OUTSIDE:
        numbers = {"poses": len(poses), "outside_share": outside, "margin_m": MARGIN_M}
        why = f"{outside:.0%} of them lie over {MARGIN_M:.0f} m outside it"
        return (TRAJECTORY_ELSEWHERE if is_given else TRAJECTORY_LEFT_OUT).found(numbers, why=why)
    if len(at) < _MIN_POSES or not np.array_equal(
        poses[:, :3, :3], np.broadcast_to(np.eye(3), (len(poses), 3, 3))
    ):
        return None  # few poses, or they are turned: points of a cloud are not
    near_m, nearest = cKDTree(at).query(points, distance_upper_bound=TOUCHING_M)
    touching = len(np.unique(nearest[np.isfinite(near_m)])) / len(at)
    if touching <= MAX_TOUCHING:
        return None
    numbers = {"poses": len(poses), "touching_share": touching}
    why = f"{touching:.0%} of them lie on a surface, as points of a cloud do"
    return (TRAJECTORY_IS_CLOUD if is_given else TRAJECTORY_LEFT_OUT).found(numbers, why=why)

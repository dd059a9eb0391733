"""Poses whose quaternions begin with w and were read as if they ended with it.

Without names of the columns nobody can tell from one row. But a robot stands upright: where the poses lie on
their side or on their back as they were read, and stand upright with w first, it is first. A sensor that
hangs upside down and turns is upright in neither order.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firstfix.bit_exact.sample import rows_by_chance
from firstfix.findings.finding import Finding
from firstfix.findings.map_kinds import TRAJECTORY_W_FIRST
from firstfix.transform import quaternion_of

UPRIGHT_DEG = 30.0
FEW, MOST = 0.5, 0.9  # of the poses are upright as they were read, and with w first
MIN_POSES, _SAMPLED_POSES = 3, 1000


def check_upright(poses: NDArray[np.float64]) -> Finding | None:
    """Finding of (m, 4, 4) poses that stand upright only if w is the quaternion's first number."""
    count = len(poses)
    if count < MIN_POSES:
        return None
    least = np.cos(np.radians(UPRIGHT_DEG))
    poses = poses[rows_by_chance(len(poses), _SAMPLED_POSES)]
    as_read = float((poses[:, 2, 2] > least).mean())
    if as_read >= FEW:
        return None
    written = np.array([quaternion_of(T) for T in poses])  # x y z w as they were read
    _, x, y, _ = written.T  # of the same four numbers, w being the first
    w_first = float((1 - 2 * (x**2 + y**2) > least).mean())
    if w_first < MOST:
        return None
    return TRAJECTORY_W_FIRST.found({"poses": count, "upright_share": as_read, "w_first_share": w_first})

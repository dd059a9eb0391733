"""Poses of one map that are not nearly the same."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from firstfix import native
from firstfix.engine.ranking import CandidatesConfig


def distinct(
    T_level_sensor: NDArray[np.float64], ranking: CandidatesConfig, most: int | None = None
) -> NDArray[np.int64]:
    """Rows of (k, 4, 4) poses of one map, ``most`` at most, that are not nearly the same as a row before."""
    most = len(T_level_sensor) if most is None else most
    return native.distinct_poses(
        T_level_sensor, ranking.same_pose_m, math.radians(ranking.same_pose_deg), most
    )

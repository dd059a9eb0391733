"""Poses of candidates in Python: the kernel of ``firstfix.native`` is held against it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firstfix.answer.prior import Prior
from firstfix.engine.retrieval.cascade import Matches, Templates
from firstfix.transform import Matrix, make_transform
from tests.reference.spread_out import spread_out


def candidates_of(
    matches: Matches,
    templates: Templates,
    levelled: tuple[NDArray[np.float64], float, Matrix],
    headings: tuple[Matrix, float, float] | None,
    most: int,
    spot: tuple[float, float, int] | None,
) -> tuple[list[int], NDArray[np.float64], list[float]]:
    """Templates, poses (k, 4, 4) and scores of the first matches that are allowed.

    Args:
        levelled: R_level_sensor, the height above the floor, and T_scan_last.
        headings: T_map_level, the middle of the headings in degrees, and the largest difference from it.
        spot: as of ``spread_out``.
    """
    R_level_sensor, height_m, T_scan_last = levelled
    position_m = templates.position_m[matches.rows].astype(np.float64)
    position_m[:, 2] += np.float32(height_m) - templates.height_m[matches.rows]
    poses = []
    for at_m, yaw_rad in zip(position_m, matches.yaw_rad, strict=True):
        c, s = np.cos(yaw_rad), np.sin(yaw_rad)
        turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        poses.append(make_transform(turn @ R_level_sensor, at_m) @ T_scan_last)
    T_level_sensor = np.array(poses).reshape(-1, 4, 4)
    rows = np.arange(len(matches.rows))
    if headings is not None:
        T_map_level, yaw_deg, range_deg = headings
        prior = Prior(np.zeros(3), np.inf, yaw_deg, range_deg)
        rows = rows[prior.allows_each(T_map_level @ T_level_sensor)]
    rows = (
        rows[:most]
        if spot is None
        else rows[spread_out(position_m[rows], matches.yaw_rad[rows], most, *spot)]
    )
    return matches.rows[rows].tolist(), T_level_sensor[rows], matches.score[rows].tolist()

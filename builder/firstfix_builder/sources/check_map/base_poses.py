"""Poses of a robot's base in place of its sensor's: they lie at the floor, where no scan can be taken."""

from __future__ import annotations

import numpy as np

from firstfix.findings.finding import Finding
from firstfix.findings.map_kinds import TRAJECTORY_AT_FLOOR, TRAJECTORY_OF_BASE

from .floors_under import FloorsUnder

# A LiDAR's housing is 7 cm high and more, so its middle is not nearer to the floor than 4 cm. Lower than
# 15 cm are the sensors of a few vacuum cleaners.
IN_FLOOR_M, AT_FLOOR_M = 0.05, 0.15
MIN_POSES, MIN_SHARE = 5, 0.5  # of the poses have a floor below them


def check_base_poses(under: FloorsUnder) -> Finding | None:
    """Finding of poses that lie at the floor."""
    height_m = under.height_m[np.isfinite(under.height_m)]
    if len(height_m) < max(MIN_POSES, MIN_SHARE * len(under.at)):
        return None
    median_m = float(np.median(height_m))
    if median_m >= AT_FLOOR_M:
        return None
    low = float((height_m < AT_FLOOR_M).mean())
    numbers = {"poses": under.poses, "height_m": median_m, "low_share": low, "low_m": AT_FLOOR_M}
    return (TRAJECTORY_OF_BASE if median_m < IN_FLOOR_M else TRAJECTORY_AT_FLOOR).found(numbers)

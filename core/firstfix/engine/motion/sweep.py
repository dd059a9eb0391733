"""Sweeps: which times show a motion, and which motions are likely."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# Scale of the twist about 0 (a Cauchy distribution), linear then angular, along the level axes. A robot
# drives and turns on its floor: the other axes are kept still, so that noise is not taken for motion.
TWIST_SCALE = np.array([1.0, 1.0, 1e-6, 1e-6, 1e-6, 1.0])  # m/s, rad/s
MIN_SWEEP_S = 0.005  # between the first and the last point: in less, nothing moves far enough to be seen


def sweep_times(time_s: NDArray[np.float32] | None) -> NDArray[np.float32] | None:
    """The (n,) times of a scan's points, or None where they cannot show a motion: a flash, or all zeros."""
    if time_s is None or not len(time_s) or float(np.ptp(time_s)) < MIN_SWEEP_S:
        return None
    return time_s

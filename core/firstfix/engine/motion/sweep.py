"""Sweeps: which times show a motion."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

MIN_SWEEP_S = 0.005  # between the first and the last point: in less, nothing moves far enough to be seen


def sweep_times(time_s: NDArray[np.float32] | None) -> NDArray[np.float32] | None:
    """The (n,) times of a scan's points, or None where they cannot show a motion: a flash, or all zeros."""
    if time_s is None or not len(time_s) or float(np.ptp(time_s)) < MIN_SWEEP_S:
        return None
    return time_s

"""Sweeps: which times show a motion, and which motions are likely."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...answer.quality import BEST_SCORE

# Scale of the twist about 0 (a Cauchy distribution), linear then angular, along the level axes. A robot
# drives and turns on its floor: the other axes are fixed, so that noise does not look like motion.
TWIST_SCALE = np.array([1.0, 1.0, 1e-6, 1e-6, 1e-6, 1.0])  # m/s, rad/s
# Speeds at which a motion is half as likely as rest. A wrong place often needs one that no robot has there.
_UNLIKELY_M_S, _UNLIKELY_RAD_S = 3.0, 4.0
_SCORE_WEIGHT = 2.5  # of the logarithm of the score's misfit in the log odds of a pose, if it counts alone
MIN_SWEEP_S = 0.005  # between the first and the last point: in less, nothing moves far enough to be seen


def sweep_times(time_s: NDArray[np.float32] | None) -> NDArray[np.float32] | None:
    """The (n,) times of a scan's points, or None where they cannot show a motion: a flash, or all zeros."""
    if time_s is None or not len(time_s) or float(np.ptp(time_s)) < MIN_SWEEP_S:
        return None
    return time_s


def discounted_score(alignment_score: float, twist: NDArray[np.float64] | None) -> float:
    """The alignment score that counts as much as this one and the likelihood of its motion together.

    Three unknowns more let a scan fit wrong places better, but with motions that are unlikely. The logarithm
    of the score's misfit has a known weight in the log odds of a pose, and so has that of the motion.

    Args:
        alignment_score: 0..1.
        twist: (6,) m/s then rad/s; None: the scan was aligned rigidly.
    """
    if twist is None:
        return alignment_score
    linear, angular = twist[:3] / _UNLIKELY_M_S, twist[3:] / _UNLIKELY_RAD_S
    odds = float((1 + linear @ linear) * (1 + angular @ angular))
    misfit = (BEST_SCORE - alignment_score) * odds ** (1 / _SCORE_WEIGHT)
    return max(BEST_SCORE - misfit, 0.0)

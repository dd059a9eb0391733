"""Rounding of estimates of a whole map, so that a change of a part of the map usually leaves them equal."""

from __future__ import annotations

import numpy as np

SPACING_STEPS = 12  # of an octave: 6 %
VIEW_STEPS = 6  # of an octave: 12 %


def stepped(value: float, per_octave: int) -> float:
    """Returns the nearest power of 2 ** (1 / per_octave) to a positive value."""
    return float(2 ** (round(np.log2(value) * per_octave) / per_octave))

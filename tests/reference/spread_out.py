"""Choice of candidates in Python: the kernel of ``firstfix.native`` is held against it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray


def spread_out(
    position_m: NDArray[np.float64],
    yaw_rad: NDArray[np.float64],
    at_most: int,
    spot_m: float,
    spot_cosine: float,
    at_most_a_spot: int,
) -> list[int]:
    """Rows of the first poses, of which at most so many are of one spot."""
    chosen: list[int] = []
    for row, (here, yaw) in enumerate(zip(position_m.tolist(), yaw_rad.tolist(), strict=True)):
        beside = sum(
            math.dist(here, position_m[other].tolist()) < spot_m
            and math.cos(yaw - float(yaw_rad[other])) > spot_cosine
            for other in chosen
        )
        if beside < at_most_a_spot:
            chosen.append(row)
        if len(chosen) == at_most:
            break
    return chosen

"""Whether large coordinates were rounded to float32 before they were stored."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firstfix.bit_exact.sample import rows_by_chance
from firstfix.findings.finding import Finding
from firstfix.findings.map_kinds import MAP_FLOAT32, MAP_ROUNDED

LOST_M, ROUNDED_M = 0.1, 0.03  # steps of the coordinates: coarser than a map's points, than a LiDAR's noise
SHIFT_STEP_M = 1000.0
_SAMPLED_POINTS = 20_000


def check_precision(coordinates: NDArray[np.float64]) -> Finding | None:
    """Finding of (n, 3) coordinates of the file that all are float32 numbers, and too large for it."""
    sample = coordinates[rows_by_chance(len(coordinates), _SAMPLED_POINTS)]
    single = sample.astype(np.float32)
    step_m = float(np.spacing(np.abs(np.median(single[:, :2], axis=0))).max())
    if step_m < ROUNDED_M or not np.array_equal(single.astype(np.float64), sample):
        return None
    shift_x_m, shift_y_m = (
        -np.round(np.median(sample[:, :2], axis=0) / SHIFT_STEP_M) * SHIFT_STEP_M
    ).tolist()
    numbers = {
        "largest_m": float(np.abs(sample).max()),
        "step_m": step_m,
        "shift_x_m": shift_x_m,
        "shift_y_m": shift_y_m,
    }
    return (MAP_FLOAT32 if step_m >= LOST_M else MAP_ROUNDED).found(numbers)

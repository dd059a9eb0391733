"""Gravity as an IMU at the sensor would measure it at a known pose."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from firstfix.errors import InvalidOption
from firstfix.transform import Matrix

MAX_NOISE_DEG = 90.0
SEED = 0


def imu_errors(count: int, noise_deg: float | None) -> Sequence[NDArray[np.float64] | None]:
    """``count`` errors of roll and pitch, each (2,) radians, the same in every run.

    Args:
        noise_deg: standard deviation; None: there is no IMU.

    Raises:
        InvalidOption: the noise is out of range.
    """
    if noise_deg is None:
        return [None] * count
    if not 0 <= noise_deg <= MAX_NOISE_DEG:
        raise InvalidOption(
            f"the noise of gravity must be in [0, {MAX_NOISE_DEG:g}] degrees, not {noise_deg}"
        )
    return list(np.radians(noise_deg) * np.random.default_rng(SEED).normal(size=(count, 2)))


def gravity_at(T_map_sensor: Matrix | None, error_rad: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """The (3,) unit vector of gravity in the sensor frame, pointing down; None without a pose.

    Args:
        T_map_sensor: pose in a map whose z axis points up.
        error_rad: (2,) errors of roll and pitch.
    """
    if T_map_sensor is None:
        return None
    off_rad = float(np.linalg.norm(error_rad))
    aside = error_rad / max(off_rad, 1e-12) * np.sin(off_rad)
    down: NDArray[np.float64] = T_map_sensor[:3, :3].T @ np.array([*aside, -np.cos(off_rad)])
    return down

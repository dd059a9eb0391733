"""Knowledge of a scan's pose that a peer may be given. Each says in its name which part it takes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

POSITION_OFF_M = 10.0  # at most


@dataclass(frozen=True)
class Prior:
    """Knowledge from other sensors.

    Attributes:
        gravity: (3,) unit vector in the sensor frame, pointing down; the true one.
        position: (2,) x and y in the map frame, up to POSITION_OFF_M from the true ones.
    """

    gravity: NDArray[np.float64]
    position: NDArray[np.float64]


def coarse_positions(count: int, seed: int) -> NDArray[np.float64]:
    """(count, 2) errors of positions in metres, spread evenly over a disc of POSITION_OFF_M."""
    away, turn = np.random.default_rng(seed).random((2, count))
    azimuth = 2 * np.pi * turn
    return POSITION_OFF_M * np.sqrt(away)[:, None] * np.column_stack([np.cos(azimuth), np.sin(azimuth)])

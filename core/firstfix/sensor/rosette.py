"""The pattern of a Livox Mid-360: four beams, no row is scanned twice.

An approximation of the table that Livox gives to simulators (``scan_mode/mid360.csv`` of
``livox_laser_simulation``, a point every 5 microseconds). The beams turn backwards 182.5 times a second.
Together they sweep over the field of view, up and down, ten times a second. In every turn the outer beams
rise and sink by 4 degrees where the sweep turns round and by 1.4 degrees in its middle, the inner ones by a
third of that. Elevations lie within 4 degrees of the table's, azimuths within 10.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

MOMENTS = 16  # at which a scan may begin
TURNS = 18.25  # in a sweep up and down, which is a scan of 0.1 s
_LAG_DEG = 27.0  # of the azimuth half way down, and its lead half way up
_HIGHEST_AT_DEG = 269.0  # azimuth at which the first beam is highest; fixed to the housing
_BEAMS = np.array([1.0, 1 / 3, -1 / 3, -1.0])  # in turn; share of the rise
_RISE_DEG, _MIDDLE_RISE_DEG = 4.1, 1.4
_BETWEEN = (np.sqrt(5) - 1) / 2  # sweeps from one moment to the next: none are alike


def rosette(
    low_deg: float, high_deg: float, count: int, moment: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Azimuths and elevations (count,) in radians of a scan, in the order of time.

    Args:
        low_deg, high_deg: field of view.
        moment: 0 to MOMENTS - 1, when the scan begins.
    """
    number = np.arange(count)
    sweeps = moment * _BETWEEN + number // len(_BEAMS) * len(_BEAMS) / count
    lag = np.radians(_LAG_DEG) * np.sin(2 * np.pi * sweeps)
    azimuth = np.radians(_HIGHEST_AT_DEG) - 2 * np.pi * TURNS * sweeps + lag
    along = np.cos(2 * np.pi * sweeps)  # 1 at the top
    rise_deg = _MIDDLE_RISE_DEG + (_RISE_DEG - _MIDDLE_RISE_DEG) * along**2
    swing_deg = (high_deg - low_deg) / 2 - _RISE_DEG
    turned = np.cos(azimuth - np.radians(_HIGHEST_AT_DEG)) * _BEAMS[number % len(_BEAMS)]
    elevation_deg = (low_deg + high_deg) / 2 + swing_deg * along + rise_deg * turned
    return (azimuth + np.pi) % (2 * np.pi) - np.pi, np.radians(elevation_deg)

"""The presets that a measured sensor looks like."""

from __future__ import annotations

import numpy as np

from ..model import SensorModel, preset
from ..presets import PRESETS

_OFF_SHARE = 0.04  # mean error of a beam, in parts of the vertical field of view: units differ from the sheet
_FEWER = 0.7  # share of the beams that must have returned: those to the sky and the floor may not
_FIELD_SHARE = 0.5  # of a rosette's field of view that must have returned: the sky does not
_OUTSIDE_DEG = 3.0  # of a rosette's field of view
_FOV_OFF_DEG = 15.0


def nearest_presets(measured: SensorModel) -> tuple[str, ...]:
    """Names of the presets with such beams, the nearest one first; several if only the columns differ.

    Of equal ones that stands first which is first in the table: a 16-beam Velodyne before what follows it.
    """
    found: list[tuple[float, float, int, str]] = []
    for number, name in enumerate(PRESETS):
        known = preset(name)
        off = _off(measured, known)
        if off is not None:
            columns = abs(np.log(known.azimuth_step_deg / measured.azimuth_step_deg))
            found.append((round(off, 1), round(float(columns), 2), number, name))
    if not found:
        return ()
    found.sort()
    return tuple(name for off, _, _, name in found if off == found[0][0])


def _off(measured: SensorModel, known: SensorModel) -> float | None:
    """How unlike the two are, 0: not at all, 1: just alike; None: they are not alike."""
    if measured.pattern != known.pattern:
        return None
    if abs(measured.azimuth_fov_deg - known.azimuth_fov_deg) > _FOV_OFF_DEG:
        return None
    here, there = np.sort(measured.elevations_deg), np.sort(known.elevations_deg)
    if measured.pattern == "rosette":
        inside = here[0] > there[0] - _OUTSIDE_DEG and here[-1] < there[-1] + _OUTSIDE_DEG
        missing = float(1 - np.ptp(here) / np.ptp(there))
        return abs(missing) if inside and missing < 1 - _FIELD_SHARE else None
    if not _FEWER * len(there) <= len(here) <= len(there):
        return None
    windows = np.lib.stride_tricks.sliding_window_view(there, len(here))
    off = float(np.abs(windows - here).mean(axis=1).min() / np.ptp(there) / _OFF_SHARE)
    missing = 1 - len(here) / len(there)
    return (off + missing) / 2 if off < 1 else None

"""Facts of a scan in NumPy: ``native.scan_facts`` and ``native.is_spread_elsewhere`` are held against it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from firstfix.engine.diagnosis.viewpoint import PROBE_M, SUSPECT
from firstfix.scan.reduction import nearest_by_direction

_RING_BIN_DEG = 0.1
_ONE_RING_DEG = 1.0
_SHARP_M = 3.0
_MAX_RINGS = 160
_MIN_POINTS = 10
_FILLED = 0.5
_BINS = np.degrees(1.0) / _RING_BIN_DEG


def scan_facts(part: NDArray[np.float32]) -> tuple[float, float, int | None, float | None]:
    """Median and largest range, rings and plane ratio of (m, 3) points."""
    square = part * part
    range_m = np.sqrt(square[:, 0] + square[:, 1] + square[:, 2])
    plane_ratio = plane_ratio_of(part) if len(part) >= _MIN_POINTS else None
    return _median(range_m), float(range_m.max()), rings_of(part[:, 2], range_m), plane_ratio


def rings_of(z_m: NDArray[np.float32], range_m: NDArray[np.float32]) -> int | None:
    """Number of elevations at which points lie, by their (n,) heights and ranges; None: they lie in no rings.

    Points nearer than _SHARP_M do not count: the rounding of coordinates blurs their elevations.
    """
    far = range_m >= _SHARP_M
    sine = z_m[far] / range_m[far]
    if len(sine) < _MIN_POINTS:
        return None
    (filled,) = np.bincount((sine * _BINS + (_BINS + 1)).astype(np.int64)).nonzero()
    span = int(filled[-1] - filled[0]) + 1
    if span <= _ONE_RING_DEG / _RING_BIN_DEG:
        return 1
    rings = 1 + int((filled[1:] - filled[:-1] > 1).sum())
    return rings if len(filled) <= _FILLED * span and rings <= _MAX_RINGS else None


def plane_ratio_of(points: NDArray[np.float32]) -> float:
    """Thickness of (n, 3) points over their breadth, as standard deviations: 0 of points in one plane."""
    least, _, most = np.linalg.eigvalsh(np.cov(points.T.astype(np.float64)))
    return math.sqrt(max(least, 0.0) / max(most, 1e-12))


def is_suspect(part: NDArray[np.float32]) -> bool:
    """Whether some hundred (n, 3) points lie in more directions seen from elsewhere.

    It is a quick probe, for every scan.
    """
    enough = SUSPECT * _directions(part, np.zeros(3, np.float32))
    middle = _middle(part)
    if _directions(part, middle) > enough:
        return True
    level_m = max(float(np.hypot(middle[0], middle[1])), 1e-3)
    return _directions(part, middle * (PROBE_M / level_m, PROBE_M / level_m, 0)) > enough


def _median(values: NDArray[np.floating]) -> float:
    """A middle one of the values; NumPy's own median takes ten times as long."""
    half, parted = len(values) // 2, values.copy()
    parted.partition(half)
    return float(parted[half])


def _middle(points: NDArray[np.float32]) -> NDArray[np.float32]:
    """Median (3,) of (n, 3) points on each axis: the ground near the sensor has most of a scan's points."""
    half, parted = len(points) // 2, points.copy()
    parted.partition(half, axis=0)
    middle: NDArray[np.float32] = parted[half]
    return middle


def _directions(points: NDArray[np.float32], at: NDArray[np.floating]) -> int:
    """Number of directions of the range view in which the points lie, seen from a place."""
    seen = np.subtract(points, at, dtype=np.float32)
    return int(np.isfinite(nearest_by_direction(seen)).sum())

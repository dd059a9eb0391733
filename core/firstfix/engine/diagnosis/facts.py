"""Facts of a scan as it came, from a part of its points: cheap enough for every query."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...answer.scan_facts import ScanFacts
from ...scan.compact import CompactScan
from ...scan.reduction import at_most, is_within_range
from ...scan.scan import Dropped, Scan
from ..config import PreprocessConfig

MEASURED = 1000  # points
RING_BIN_DEG = 0.1
ONE_RING_DEG = 1.0
MOST_RINGS = 160
_LEAST = 10  # points: fewer have no shape
_FILLED = 0.5  # of the bins between the lowest and the highest point: with more, they are in no rings
_BINS_A_RADIAN = np.degrees(1.0) / RING_BIN_DEG
_LEVEL_BIN = round(90 / RING_BIN_DEG) + 1


def facts_of(
    scan: Scan | CompactScan, dropped: Dropped, config: PreprocessConfig, in_range: int | None = None
) -> ScanFacts:
    """The facts of a scan.

    Args:
        dropped: points that the scan does not have.
        config: of the map that is asked.
        in_range: number of the points in range, if it is known.
    """
    points = scan.points
    if in_range is None:
        in_range = int(np.count_nonzero(is_within_range(points, config.min_range_m, config.max_range_m)))
    if not len(points):
        far_m = dropped.far_m if dropped.too_far else None
        return ScanFacts(dropped.points, 0, 0, far_m)
    part = at_most(points, MEASURED)
    range_m = np.sqrt(np.square(part).sum(axis=1, dtype=np.float64))
    used = (range_m > config.min_range_m) & (range_m < config.max_range_m)
    near, near_m = part[used], range_m[used]
    has_shape = len(near) >= _LEAST
    median_m = float(np.median(range_m))
    return ScanFacts(
        len(points) + dropped.points,
        len(points),
        in_range,
        dropped.far_m if dropped.too_far > len(points) else median_m,
        float(range_m.max()),
        rings_of(near, near_m) if has_shape else None,
        plane_ratio_of(near) if has_shape else None,
        None if scan.time_s is None or not len(scan.time_s) else float(np.ptp(scan.time_s)),
    )


def rings_of(points: NDArray[np.float32], range_m: NDArray[np.float64]) -> int | None:
    """Number of elevations at which (n, 3) points lie; None: they lie in no rings.

    It is counted by the farther half: of near points, the rounding of coordinates blurs the elevation.
    """
    far = range_m >= np.median(range_m)
    elevation = np.arcsin(np.clip(points[far, 2] / range_m[far], -1, 1))
    filled = np.flatnonzero(np.bincount((elevation * _BINS_A_RADIAN).astype(np.int64) + _LEVEL_BIN))
    span = int(filled[-1] - filled[0]) + 1
    if span <= ONE_RING_DEG / RING_BIN_DEG:
        return 1
    rings = 1 + int(np.count_nonzero(np.diff(filled) > 1))
    return rings if len(filled) <= _FILLED * span and rings <= MOST_RINGS else None


def plane_ratio_of(points: NDArray[np.float32]) -> float:
    """Thickness of (n, 3) points over their breadth, as standard deviations: 0 of points in one plane."""
    off = points.astype(np.float64) - points.mean(axis=0, dtype=np.float64)
    variances = np.linalg.eigvalsh(off.T @ off)
    return float(np.sqrt(max(variances[0], 0.0) / max(variances[2], 1e-12)))

"""Facts of a scan as it came, from a part of its points: cheap enough for every query."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...answer.scan_facts import ScanFacts
from ...scan.compact import CompactScan
from ...scan.reduction import is_within_range
from ...scan.scan import Dropped, Scan
from ..config import PreprocessConfig

MEASURED = 500  # points: each is a miss of the processor's cache
RING_BIN_DEG = 0.1
ONE_RING_DEG = 1.0
SHARP_M = 3.0  # from here, a centimetre is 0.2 degrees at most
MAX_RINGS = 160
WHOLE = 0.7  # of the decimetres in x, the whole metres: intensities 0.97 at least, right scans 0.22 at most
MIN_LEVELS = 10  # of an intensity: fewer are chance
_DECIMETRES = 10.0  # in a metre
OFF_LINE = 0.3  # of points on a line; of right scans it is 0.4 at least, of arrays (3, n) 0.21 at most
_MIN_POINTS = 10  # points: fewer have no shape
_FILLED = 0.5  # of the bins between the lowest and the highest point: with more, they are in no rings
_BINS = np.degrees(1.0) / RING_BIN_DEG  # of the sine, from 0 to 1: towards the poles they are wider


def facts_of(
    scan: Scan | CompactScan,
    part: NDArray[np.float32],
    dropped: Dropped,
    config: PreprocessConfig,
    in_range: int | None = None,
) -> ScanFacts:
    """The facts of a scan.

    Args:
        part: (m, 3) of its points, at most MEASURED, by chance.
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
    square = part * part
    range_m = np.sqrt(square[:, 0] + square[:, 1] + square[:, 2])
    median_m = dropped.far_m if dropped.too_far > len(points) else _median(range_m)
    return ScanFacts(
        len(points) + dropped.points,
        len(points),
        in_range,
        median_m,
        float(range_m.max()),
        rings_of(part[:, 2], range_m),
        plane_ratio_of(part) if len(part) >= _MIN_POINTS else None,
        None if scan.time_s is None or not len(scan.time_s) else float(np.ptp(scan.time_s)),
    )


def rings_of(z_m: NDArray[np.float32], range_m: NDArray[np.float32]) -> int | None:
    """Number of elevations at which points lie, by their (n,) heights and ranges; None: they lie in no rings.

    Points nearer than SHARP_M do not count: the rounding of coordinates blurs their elevations.
    """
    far = range_m >= SHARP_M
    sine = z_m[far] / range_m[far]
    if len(sine) < _MIN_POINTS:
        return None
    (filled,) = np.bincount((sine * _BINS + (_BINS + 1)).astype(np.int64)).nonzero()
    span = int(filled[-1] - filled[0]) + 1
    if span <= ONE_RING_DEG / RING_BIN_DEG:
        return 1
    rings = 1 + int((filled[1:] - filled[:-1] > 1).sum())
    return rings if len(filled) <= _FILLED * span and rings <= MAX_RINGS else None


def plane_ratio_of(points: NDArray[np.float32]) -> float:
    """Thickness of (n, 3) points over their breadth, as standard deviations: 0 of points in one plane."""
    exact = points.astype(np.float64)
    total = exact.sum(axis=0)
    scatter = exact.T @ exact - total[:, None] * (total / len(exact))
    least, most = eigenvalue_bounds(scatter.tolist())
    return math.sqrt(max(least, 0.0) / max(most, 1e-12))


def is_on_a_line(part: NDArray[np.float32]) -> bool:
    """Whether (m, 3) points lie on the line x = y = z: by their distances from it over their ranges.

    Correlated coordinates alone do not show it: those of a part of the turn at 45 degrees are.
    """
    points = part.astype(np.float64)
    squares = float(np.sum(points**2))
    if len(points) < MEASURED or squares == 0:
        return False
    off = points - points.mean(axis=1, keepdims=True)
    return math.sqrt(float(np.sum(off**2)) / squares) < OFF_LINE


def is_intensity_first(part: NDArray[np.float32]) -> bool:
    """Whether x of (m, 3) points is an intensity or a ring: whole numbers, none below 0.

    A right scan whose x is never negative, because it looks forward only, has few whole numbers among them.
    """
    x, y, _ = part.T
    if float(x.min(initial=0)) < -0.5 / _DECIMETRES:  # as exact as a range image
        return False
    # a scan that was thinned to a grid of metres has whole numbers in y too
    return _has_whole_metres_only(x) and not _has_whole_metres_only(y)


def _has_whole_metres_only(values_m: NDArray[np.float32]) -> bool:
    """Whether nearly all of (m,) coordinates are whole numbers, of several values.

    Each decimetre counts once: a wall at a whole distance has many points, and says nothing.
    """
    decimetres = np.unique(np.rint(values_m * _DECIMETRES))
    return len(decimetres) >= MIN_LEVELS and float(np.mean(decimetres % _DECIMETRES == 0)) > WHOLE


def eigenvalue_bounds(matrix: Sequence[Sequence[float]]) -> tuple[float, float]:
    """Least and largest eigenvalue of a symmetric (3, 3) matrix, in closed form: a library's call costs more.

    O. K. Smith, "Eigenvalues of a symmetric 3 x 3 matrix", 1961.
    """
    (a, d, e), (_, b, f), (_, _, c) = matrix
    mean = (a + b + c) / 3
    a, b, c = a - mean, b - mean, c - mean
    spread = math.sqrt((a**2 + b**2 + c**2 + 2 * (d * d + e * e + f * f)) / 6)
    if spread == 0:
        return mean, mean
    a, b, c, d, e, f = a / spread, b / spread, c / spread, d / spread, e / spread, f / spread
    half = (a * (b * c - f * f) - d * (d * c - f * e) + e * (d * f - b * e)) / 2
    angle = math.acos(min(max(half, -1.0), 1.0)) / 3
    return mean + 2 * spread * math.cos(angle + 2 * math.pi / 3), mean + 2 * spread * math.cos(angle)


def _median(values: NDArray[np.floating]) -> float:
    """A middle one of the values; NumPy's own median takes ten times as long."""
    half, parted = len(values) // 2, values.copy()
    parted.partition(half)
    return float(parted[half])

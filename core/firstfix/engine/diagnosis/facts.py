"""Facts of a scan as it came, from a part of its points: cheap enough for every query.

Compiled: ``native/include/firstfix/query/scan_facts.hpp``.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...answer.scan_facts import ScanFacts
from ...native import scan_facts
from ...scan.compact import CompactScan
from ...scan.reduction import within_range
from ...scan.scan import Dropped, Scan
from ..config import PreprocessConfig

MEASURED = 500  # points: each is a miss of the processor's cache
WHOLE = 0.7  # of the decimetres in x, the whole metres: intensities 0.97 at least, right scans 0.22 at most
MIN_LEVELS = 10  # of an intensity: fewer are chance
_DECIMETRES = 10.0  # in a metre
OFF_LINE = 0.3  # of points on a line; of right scans it is 0.4 at least, of arrays (3, n) 0.21 at most


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
        in_range = len(within_range(points, config.min_range_m, config.max_range_m))
    if not len(points):
        far_m = dropped.far_m if dropped.too_far else None
        return ScanFacts(dropped.points, 0, 0, far_m)
    median_m, largest_m, rings, plane_ratio = scan_facts(part)
    if dropped.too_far > len(points):
        median_m = dropped.far_m
    time_s = scan.time_s
    span_s = None if time_s is None or not len(time_s) else float(np.ptp(time_s))
    return ScanFacts(
        len(points) + dropped.points, len(points), in_range, median_m, largest_m, rings, plane_ratio, span_s
    )


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

"""A scan as it would have been seen at its stamp, for a known motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ... import native
from ...scan.compact import CompactScan
from ...scan.reduction import TimedPoints, directions, nearest_by_direction
from ...scan.scan import Scan


def at_stamp(scan: Scan | CompactScan, twist: NDArray[np.float64]) -> Scan | CompactScan:
    """The scan, deskewed. It has the times of its points.

    Args:
        twist: (6,) m/s then rad/s, in the sensor frame.
    """
    assert scan.time_s is not None
    points = native.deskew(scan.points, scan.time_s, twist)
    if isinstance(scan, Scan):
        return replace(scan, points=points, time_s=None)
    returns = timed_view(TimedPoints(scan.points, scan.time_s), scan.nearest_m)
    assert returns.time_s is not None
    nearest_m = nearest_by_direction(native.deskew(returns.points, returns.time_s, twist))
    return replace(scan, points=points, time_s=None, nearest_m=nearest_m)


def timed_view(timed: TimedPoints, nearest_m: NDArray[np.float32]) -> TimedPoints:
    """The returns of a range view, each in the middle of its direction.

    Its time is the mean of those of the points in its column. A spinning sensor sees a column at one time.
    The times of any other one are spread over its columns: their mean then changes little.

    Args:
        timed: points of the scan, with times.
        nearest_m: (cells,) nearest ranges by direction, infinite where nothing returned.
    """
    assert timed.time_s is not None
    return TimedPoints(*native.timed_view(timed.points, timed.time_s, nearest_m, directions()))

"""Times of a compact scan's ranges by direction, which come without any."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...scan.range_view import COLUMNS, directions
from ...scan.voxel_filter import TimedPoints


def timed_view(timed: TimedPoints, nearest_m: NDArray[np.float32]) -> TimedPoints:
    """The returns of a range view, each in the middle of its direction.

    Its time is the mean of those of the points in its column. A spinning sensor sees a column at one time.
    The times of any other one are spread over its columns: their mean then changes little.

    Args:
        timed: points of the scan, with times.
        nearest_m: (cells,) nearest ranges by direction, infinite where nothing returned.
    """
    assert timed.time_s is not None
    azimuth = np.arctan2(timed.points[:, 1], timed.points[:, 0])
    of_point = ((azimuth / (2 * np.pi) + 0.5) * COLUMNS).astype(np.int64) % COLUMNS
    count = np.bincount(of_point, minlength=COLUMNS)
    mean_s = np.bincount(of_point, timed.time_s, COLUMNS) / np.maximum(count, 1)
    known = np.flatnonzero(count)
    column_s = np.interp(np.arange(COLUMNS), known, mean_s[known]) if len(known) else mean_s
    seen = np.flatnonzero(np.isfinite(nearest_m))
    returns = directions()[seen] * nearest_m[seen, None]
    return TimedPoints(returns, column_s[seen % COLUMNS].astype(np.float32))

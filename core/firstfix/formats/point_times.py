"""Times of the points of a cloud, under the names and in the units of drivers and file formats."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..scan.scan import MAX_ABS_TIME_S
from .point_cloud import Column

# Of Ouster, Livox, Velodyne, Hesai and RoboSense, Autoware, LAS, CloudCompare.
TIME_NAMES = ("t", "offset_time", "time", "timestamp", "time_stamp", "gps_time", "scalar_gpstime")
_NANOSECONDS = 1e-9
_EPOCH_S = 1e8  # later than this, a time counts from the epoch, and not from the scan's begin
_EPOCH_NS = 1e15
_LEAST_S = 1e-4  # from the first to the last point: drivers fill in zeros where they do not know the times


@dataclass(frozen=True)
class PointTimes:
    """Times of a scan's points.

    Attributes:
        time_s: (n,) float32 seconds from the stamp; 0 for a point that is not finite.
        stamp_s: the cloud's own stamp; else the time of the first point, if it counts from the epoch; else
            None.
    """

    time_s: NDArray[np.float32]
    stamp_s: float | None


def point_times(columns: Mapping[str, Column], stamp_s: float | None) -> PointTimes | None:
    """Times of the points, or None: there is no such column, or its numbers are not the times of one scan.

    Integers are nanoseconds. Real numbers are seconds, or nanoseconds where they are too large for seconds.
    Times since the epoch count from the stamp. Those that are not within MAX_ABS_TIME_S of it then, by the
    clock of another device, count from the first point.

    Args:
        columns: (n,) each, x, y and z among them.
        stamp_s: of the cloud, in seconds since the epoch.
    """
    column = _column(columns)
    if column is None:
        return None
    with np.errstate(invalid="ignore", over="ignore"):  # any bits may stand in a message
        usable = np.isfinite(columns["x"]) & np.isfinite(columns["y"]) & np.isfinite(columns["z"])
        seconds = np.where(usable, column, np.float64(0))
    taken = seconds[usable]
    if not len(taken) or not np.isfinite(taken).all():
        return None
    if column.dtype.kind in "iu" or np.ptp(taken) > MAX_ABS_TIME_S or np.abs(taken).max() > _EPOCH_NS:
        seconds, taken = seconds * _NANOSECONDS, taken * _NANOSECONDS
    if np.ptp(taken) < _LEAST_S:
        return None
    first = float(taken.min())
    of_epoch = first > _EPOCH_S
    if of_epoch and stamp_s is None:
        stamp_s = first
    from_stamp = seconds - stamp_s if of_epoch and stamp_s is not None else seconds
    for relative in (from_stamp, seconds - first):
        if float(np.abs(relative[usable]).max()) <= MAX_ABS_TIME_S:
            return PointTimes(np.where(usable, relative, 0).astype(np.float32), stamp_s)
    return None


def _column(columns: Mapping[str, Column]) -> Column | None:
    by_name = {name.lower(): column for name, column in columns.items()}
    names = TIME_NAMES[1:] if "s" in by_name else TIME_NAMES  # s and t together are places in a picture
    column = next((by_name[name] for name in names if name in by_name), None)
    return None if column is None or column.dtype.kind not in "iuf" else column

"""The result of a format decoder, its limits, and the times of its points in seconds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import MalformedData, TooLarge
from ..scan.scan import MAX_ABS_TIME_S, MAX_POINTS

Body = bytes | memoryview
Column = NDArray[Any]

INTENSITY_NAMES = ("intensity", "scalar_intensity", "reflectivity", "reflectance", "i")
# Of Ouster, Livox, Velodyne, Hesai and RoboSense, Autoware, LAS, CloudCompare.
TIME_NAMES = ("t", "offset_time", "time", "timestamp", "time_stamp", "gps_time", "scalar_gpstime")
# Of Velodyne, Ouster, Hesai and RoboSense, and of NCLT, Pandar, Livox; a Livox's lines are no rings.
RING_NAMES = ("ring", "laser", "laser_id", "channel", "line")
_NANOSECONDS = 1e-9
_EPOCH_S = 1e8  # later than this, a time counts from the epoch, and not from the scan's begin
_EPOCH_NS = 1e15
_MIN_S = 1e-4  # from the first to the last point: drivers fill in zeros where they do not know the times


@dataclass(frozen=True)
class Limits:
    """Limits of a decoder's result. The caller limits the size of the input.

    Attributes:
        max_points: number of points in one cloud.
        max_decoded_bytes: memory of the decoded records.
    """

    max_points: int
    max_decoded_bytes: int

    def check(self, format_name: str, points: int, record_bytes: int) -> None:
        """Check the size that a header declares.

        Raises:
            TooLarge: more points or bytes than allowed.
        """
        if points > self.max_points:
            raise TooLarge(f"{format_name}: {points} points, the limit is {self.max_points}")
        if points * record_bytes > self.max_decoded_bytes:
            raise TooLarge(
                f"{format_name}: {points} points of {record_bytes} bytes, the limit is "
                f"{self.max_decoded_bytes} bytes"
            )


SCAN_LIMITS = Limits(max_points=MAX_POINTS, max_decoded_bytes=256_000_000)
MAP_LIMITS = Limits(max_points=300_000_000, max_decoded_bytes=16_000_000_000)


@dataclass(frozen=True)
class PointCloud:
    """The columns of a file. A binary format keeps its number types.

    Attributes:
        columns: (n,) array of each name. x, y and z are always present. Rows with NaN are kept.
    """

    columns: Mapping[str, Column]

    def __len__(self) -> int:
        return len(self.columns["x"])

    @property
    def xyz(self) -> NDArray[np.float64]:
        """(n, 3) float64, so that UTM coordinates keep the precision of the file."""
        xyz = np.empty((len(self), 3), np.float64)
        with np.errstate(invalid="ignore"):  # signalling NaNs of damaged files and of some drivers
            for axis, name in enumerate("xyz"):
                xyz[:, axis] = self.columns[name]
        return xyz

    @property
    def intensity(self) -> Column | None:
        """The (n,) intensity, under any name that drivers or CloudCompare use. None if absent."""
        by_name = {name.lower(): column for name, column in self.columns.items()}
        return next((by_name[name] for name in INTENSITY_NAMES if name in by_name), None)

    @property
    def ring(self) -> Column | None:
        """The (n,) numbers of the beams, under any name that drivers use, as integers. None if absent."""
        by_name = {name.lower(): column for name, column in self.columns.items()}
        found = next((by_name[name] for name in RING_NAMES if name in by_name), None)
        if found is None or found.dtype.kind in "iu":
            return found
        whole = np.isfinite(found) & (np.abs(found) < 1e6) if found.dtype.kind == "f" else None
        return None if whole is None else np.where(whole, found, -1).astype(np.int64)


def require_xyz(format_name: str, names: set[str]) -> None:
    """Check that x, y and z are among the names.

    Raises:
        MalformedData: one of them is missing.
    """
    missing = [axis for axis in "xyz" if axis not in names]
    if missing:
        raise MalformedData(f"{format_name}: no field {', '.join(missing)}")


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
    if np.ptp(taken) < _MIN_S:
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

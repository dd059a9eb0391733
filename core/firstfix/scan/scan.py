"""One LiDAR scan, checked once when it enters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..bit_exact.accelerated import accelerated
from ..errors import InvalidScan, TooLarge
from .reduction import at_most
from .time_field import TimeField

MAX_POINTS = 2_000_000  # an OS1-128 at 2048 columns has 262,144; merged scans stay below this limit
MAX_ABS_COORDINATE_M = 1_000.0  # beyond the range of any scanner on a robot
_MAX_COLUMNS = 64  # of numbers about one point
_MEASURED = 4096  # of the points that are dropped
_MAX_M = 1e9  # a length beyond means nothing
MAX_ABS_TIME_S = 1.0  # of a point from its scan's stamp: revolutions take 0.05 to 0.2 s


@accelerated
def usable_points(
    x: NDArray[np.floating], y: NDArray[np.floating], z: NDArray[np.floating]
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """The (m, 3) points that are finite and not impossibly far, and for every point whether it is so.

    Args:
        x: (n,), like y and z; all three float32, or all three float64.
    """
    with np.errstate(invalid="ignore"):  # NaN compares false
        usable = (np.abs(x) <= MAX_ABS_COORDINATE_M) & (np.abs(y) <= MAX_ABS_COORDINATE_M)
        usable &= np.abs(z) <= MAX_ABS_COORDINATE_M
    return np.stack([x[usable], y[usable], z[usable]], axis=1).astype(np.float32), usable


@accelerated
def all_within(points: NDArray[np.float32], limit_m: float) -> bool:
    """Whether no coordinate of the (n, 3) points is NaN or beyond the limit."""
    return bool(np.abs(points).max(initial=0) <= np.float64(limit_m))


def is_transposed(shape: tuple[int, ...]) -> bool:
    """Whether the shape of an array is that of points side by side, (3, n) or (4, n)."""
    return shape[0] in (3, 4) and shape[1] > _MAX_COLUMNS


@dataclass(frozen=True)
class Dropped:
    """Points that a scan does not keep.

    Attributes:
        not_finite: NaN or infinite.
        too_far: beyond MAX_ABS_COORDINATE_M.
        far_m: median distance of those too far from the origin; 0 without one.
        spread_m: median distance of those too far from their own middle.
    """

    not_finite: int = 0
    too_far: int = 0
    far_m: float = 0.0
    spread_m: float = 0.0

    @classmethod
    def of(cls, columns: Sequence[NDArray[np.floating]], count: int) -> Dropped:
        """Of the (n,) columns of all points, the ``count`` that are dropped."""
        if not count:
            return cls()
        finite = np.isfinite(columns[0]) & np.isfinite(columns[1]) & np.isfinite(columns[2])
        not_finite = len(finite) - int(np.count_nonzero(finite))
        if count == not_finite:
            return cls(not_finite)
        points = np.stack([column[finite] for column in columns], axis=1).astype(np.float64)
        far = at_most(points[(np.abs(points) > MAX_ABS_COORDINATE_M).any(axis=1)], _MEASURED)
        far_m = float(np.median(np.linalg.norm(far, axis=1)))
        spread_m = float(np.median(np.linalg.norm(far - np.median(far, axis=0), axis=1)))
        return cls(not_finite, count - not_finite, min(far_m, _MAX_M), min(spread_m, _MAX_M))

    @property
    def points(self) -> int:
        """Number of these points."""
        return self.not_finite + self.too_far


@dataclass(frozen=True)
class Scan:
    """Points of one scan in the sensor frame (REP-103: x forward, y left, z up), metres.

    Attributes:
        points: (n, 3) float32, all finite.
        intensity: (n,) float32 or None.
        stamp_s: time of the scan in seconds since the epoch, or None.
        time_s: (n,) float32, time of each point in seconds from the stamp, within MAX_ABS_TIME_S; None: not
            known. With it, the motion of the sensor during the scan is solved with its pose.
        dropped: points that were not kept.
        time_field: the field of the cloud that gave ``time_s``; or one that looks like it and was not
            understood.
    """

    points: NDArray[np.float32]
    intensity: NDArray[np.float32] | None = None
    stamp_s: float | None = None
    time_s: NDArray[np.float32] | None = None
    dropped: Dropped = Dropped()
    time_field: TimeField | None = None

    @classmethod
    def from_points(
        cls,
        points: ArrayLike,
        intensity: ArrayLike | None = None,
        stamp_s: float | None = None,
        time_s: ArrayLike | None = None,
    ) -> Scan:
        """Check points from a driver and drops returns that are NaN, infinite or impossibly far.

        Args:
            points: (n, 3 or more) numbers; the first three columns are x, y, z in metres.
            intensity: (n,) or None.
            time_s: (n,) seconds from the stamp, or None.

        Raises:
            InvalidScan: points of another shape, no numbers, an intensity or times of another length, or a
                time of a point beyond MAX_ABS_TIME_S.
            TooLarge: over MAX_POINTS points.
        """
        array = np.asarray(points)
        if array.ndim == 2 and is_transposed(array.shape):
            raise InvalidScan(f"the array has the shape {array.shape}; scans are (n, 3): transpose it")
        if array.ndim != 2 or array.shape[1] < 3 or not np.issubdtype(array.dtype, np.number):
            raise InvalidScan(f"a scan must be an (n, 3) array of numbers, not {array.dtype} {array.shape}")
        return cls.from_columns(array[:, 0], array[:, 1], array[:, 2], intensity, stamp_s, time_s)

    @classmethod
    def from_columns(
        cls,
        x: NDArray[Any],
        y: NDArray[Any],
        z: NDArray[Any],
        intensity: ArrayLike | None = None,
        stamp_s: float | None = None,
        time_s: ArrayLike | None = None,
        time_field: TimeField | None = None,
    ) -> Scan:
        """Like ``from_points``, with each axis in an array of its own.

        The columns may be views of a message: their numbers are copied once.

        Args:
            x: (n,) numbers in metres, like y and z.
        """
        n = len(x)
        if n > MAX_POINTS:
            raise TooLarge(f"the scan has {n} points, the limit is {MAX_POINTS}")
        values = _one_each("intensities", intensity, n)
        times = _one_each("times", time_s, n)
        columns = _of_one_type(x, y, z)
        points, usable = usable_points(*columns)
        with np.errstate(invalid="ignore", over="ignore"):  # any bits may stand in a message
            dropped = Dropped.of(columns, n - len(points))
        if values is not None:
            values = np.ascontiguousarray(values[usable], np.float32)
        if times is not None:
            times = np.ascontiguousarray(times[usable], np.float32)
            if not float(np.abs(times).max(initial=0)) <= MAX_ABS_TIME_S:
                raise InvalidScan(f"a point's time is not within {MAX_ABS_TIME_S:g} s of the scan's stamp")
        return cls(points, values, stamp_s, times, dropped, time_field)

    def __len__(self) -> int:
        return len(self.points)


def _one_each(name: str, values: ArrayLike | None, count: int) -> NDArray[Any] | None:
    if values is None:
        return None
    array = np.asarray(values)
    if array.shape != (count,):
        raise InvalidScan(f"{array.shape} {name} for {count} points")
    return array


def _of_one_type(*columns: NDArray[Any]) -> list[NDArray[np.floating]]:
    """The columns: as float32 where all are, otherwise as float64."""
    dtype: type[np.floating] = np.float32
    for column in columns:
        if column.dtype != np.float32:
            dtype = np.float64
    return [np.asarray(column, dtype) for column in columns]

"""One LiDAR scan, checked once when it enters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..bit_exact.accelerated import accelerated
from ..errors import InvalidScan, TooLarge

MAX_POINTS = 2_000_000  # an OS1-128 at 2048 columns has 262,144; merged scans stay below this limit
MAX_ABS_COORDINATE_M = 1_000.0  # beyond the range of any scanner on a robot
MAX_ABS_TIME_S = 1.0  # of a point from its scan's stamp: revolutions take 0.05 to 0.2 s


@accelerated
def usable_points(
    x: NDArray[np.floating], y: NDArray[np.floating], z: NDArray[np.floating]
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Returns the (m, 3) points that are finite and not impossibly far, and for every point whether it is so.

    Args:
        x: (n,), like y and z; all three float32, or all three float64.
    """
    with np.errstate(invalid="ignore"):  # NaN compares false
        usable = (np.abs(x) <= MAX_ABS_COORDINATE_M) & (np.abs(y) <= MAX_ABS_COORDINATE_M)
        usable &= np.abs(z) <= MAX_ABS_COORDINATE_M
    return np.stack([x[usable], y[usable], z[usable]], axis=1).astype(np.float32), usable


@accelerated
def all_within(points: NDArray[np.float32], limit_m: float) -> bool:
    """Returns whether no coordinate of the (n, 3) points is NaN or beyond the limit."""
    return bool(np.abs(points).max(initial=0) <= np.float64(limit_m))


@dataclass(frozen=True)
class Scan:
    """Points of one scan in the sensor frame (REP-103: x forward, y left, z up), metres.

    Attributes:
        points: (n, 3) float32, all finite.
        intensity: (n,) float32 or None.
        stamp_s: time of the scan in seconds since the epoch, or None.
        time_s: (n,) float32, time of each point in seconds from the stamp, within MAX_ABS_TIME_S; None: not
            known. With it, the motion of the sensor during the scan is solved with its pose.
    """

    points: NDArray[np.float32]
    intensity: NDArray[np.float32] | None = None
    stamp_s: float | None = None
    time_s: NDArray[np.float32] | None = None

    @classmethod
    def from_points(
        cls,
        points: ArrayLike,
        intensity: ArrayLike | None = None,
        stamp_s: float | None = None,
        time_s: ArrayLike | None = None,
    ) -> Scan:
        """Checks points from a driver and drops returns that are NaN, infinite or impossibly far.

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
        points, usable = usable_points(*_of_one_type(x, y, z))
        if values is not None:
            values = np.ascontiguousarray(values[usable], np.float32)
        if times is not None:
            times = np.ascontiguousarray(times[usable], np.float32)
            if not float(np.abs(times).max(initial=0)) <= MAX_ABS_TIME_S:
                raise InvalidScan(f"a point's time is not within {MAX_ABS_TIME_S:g} s of the scan's stamp")
        return cls(points, values, stamp_s, times)

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
    """Returns the columns, aligned: as float32 where all are, otherwise as float64."""
    single = all(column.dtype == np.float32 for column in columns)
    return [np.require(column, np.float32 if single else np.float64, "A") for column in columns]

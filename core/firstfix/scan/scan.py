"""One LiDAR scan, checked once when it enters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InvalidScan, TooLarge

MAX_POINTS = 2_000_000  # an OS1-128 at 2048 columns has 262,144; merged scans stay below this limit
MAX_ABS_COORDINATE_M = 1_000.0  # beyond the range of any scanner on a robot


@dataclass(frozen=True)
class Scan:
    """Points of one scan in the sensor frame (REP-103: x forward, y left, z up), metres.

    Attributes:
        points: (n, 3) float32, all finite.
        intensity: (n,) float32 or None.
        stamp_s: time of the scan in seconds since the epoch, or None.
    """

    points: NDArray[np.float32]
    intensity: NDArray[np.float32] | None = None
    stamp_s: float | None = None

    @classmethod
    def from_points(
        cls,
        points: ArrayLike,
        intensity: ArrayLike | None = None,
        stamp_s: float | None = None,
    ) -> Scan:
        """Checks points from a driver and drops returns that are NaN, infinite or impossibly far.

        Args:
            points: (n, 3 or more) numbers; the first three columns are x, y, z in metres.
            intensity: (n,) or None.

        Raises:
            InvalidScan: points of another shape, no numbers, or an intensity of another length.
            TooLarge: over MAX_POINTS points.
        """
        array = np.asarray(points)
        if array.ndim != 2 or array.shape[1] < 3 or not np.issubdtype(array.dtype, np.number):
            raise InvalidScan(f"a scan must be an (n, 3) array of numbers, not {array.dtype} {array.shape}")
        if len(array) > MAX_POINTS:
            raise TooLarge(f"the scan has {len(array)} points, the limit is {MAX_POINTS}")
        xyz = array[:, :3]
        with np.errstate(invalid="ignore"):
            keep = (np.abs(xyz) <= MAX_ABS_COORDINATE_M).all(axis=1)  # NaN compares false
        kept_intensity = None
        if intensity is not None:
            values = np.asarray(intensity)
            if values.shape != (len(array),):
                raise InvalidScan(f"{values.shape} intensities for {len(array)} points")
            kept_intensity = np.ascontiguousarray(values[keep], np.float32)
        return cls(np.ascontiguousarray(xyz[keep], np.float32), kept_intensity, stamp_s)

    def __len__(self) -> int:
        return len(self.points)

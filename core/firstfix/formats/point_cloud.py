"""What a format decoder returns, and the limits it works under."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import MalformedData, TooLarge
from ..scan.scan import MAX_POINTS

Body = bytes | memoryview
Column = NDArray[Any]

INTENSITY_NAMES = ("intensity", "scalar_intensity", "reflectivity", "reflectance", "i")


@dataclass(frozen=True)
class Limits:
    """What a decoder may produce. The input's own size is the caller's to limit.

    Attributes:
        max_points: points of one cloud.
        max_decoded_bytes: memory of the decoded records.
    """

    max_points: int
    max_decoded_bytes: int

    def check(self, format_name: str, points: int, record_bytes: int) -> None:
        """Refuses a cloud by what its header promises.

        Raises:
            TooLarge: more points, or more bytes, than may be decoded.
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
    """Columns as the file names them, in its own number types where the format is binary.

    Attributes:
        columns: name to (n,) array; x, y and z are always there. NaN rows are kept.
    """

    columns: Mapping[str, Column]

    def __len__(self) -> int:
        return len(self.columns["x"])

    @property
    def xyz(self) -> NDArray[np.float64]:
        """(n, 3) float64: UTM-sized coordinates keep the precision that the file has."""
        xyz = np.empty((len(self), 3), np.float64)
        with np.errstate(invalid="ignore"):  # a signalling NaN: damaged, or what a driver left there
            for axis, name in enumerate("xyz"):
                xyz[:, axis] = self.columns[name]
        return xyz

    @property
    def intensity(self) -> Column | None:
        """(n,) under the names that drivers and CloudCompare give it, or None."""
        by_name = {name.lower(): column for name, column in self.columns.items()}
        return next((by_name[name] for name in INTENSITY_NAMES if name in by_name), None)


def require_xyz(format_name: str, names: set[str]) -> None:
    """Raises MalformedData when a column of x, y, z is not among the names."""
    missing = [axis for axis in "xyz" if axis not in names]
    if missing:
        raise MalformedData(f"{format_name}: no field {', '.join(missing)}")

"""The result of a format decoder, and its limits."""

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
    """Limits of a decoder's result. The caller limits the size of the input.

    Attributes:
        max_points: number of points in one cloud.
        max_decoded_bytes: memory of the decoded records.
    """

    max_points: int
    max_decoded_bytes: int

    def check(self, format_name: str, points: int, record_bytes: int) -> None:
        """Checks the size that a header declares.

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
        """Returns (n, 3) float64, so that UTM coordinates keep the precision of the file."""
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


def require_xyz(format_name: str, names: set[str]) -> None:
    """Checks that x, y and z are among the names.

    Raises:
        MalformedData: one of them is missing.
    """
    missing = [axis for axis in "xyz" if axis not in names]
    if missing:
        raise MalformedData(f"{format_name}: no field {', '.join(missing)}")

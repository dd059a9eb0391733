"""The result of a format decoder, and its limits."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import MalformedData, TooLarge
from ..scan.scan import MAX_POINTS

Body = bytes | memoryview
Column = NDArray[Any]

_SHOWN = 20  # fields of a file that an error names
INTENSITY_NAMES = ("intensity", "scalar_intensity", "reflectivity", "reflectance", "i")
# Of Velodyne, Ouster, Hesai and RoboSense, and of NCLT, Pandar, Livox; a Livox's lines are no rings.
RING_NAMES = ("ring", "laser", "laser_id", "channel", "line")


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


def axes_of(format_name: str, names: Iterable[str]) -> dict[str, str]:
    """The names of a file's fields for the axes: x, y, z in small letters, else in capitals.

    Raises:
        MalformedData: one of them is missing; the error names the fields that are there.
    """
    there = list(names)
    found: dict[str, str] = {}
    missing = []
    for axis in "xyz":
        if axis in there:
            found[axis] = axis
        elif axis.upper() in there:
            found[axis] = axis.upper()
        else:
            missing.append(axis)
    if missing:
        shown = ", ".join(name[:40] for name in there[:_SHOWN]) or "none"
        raise MalformedData(f"{format_name}: no field {', '.join(missing)}; its fields: {shown}")
    return found


def with_axes(format_name: str, columns: Mapping[str, Column]) -> dict[str, Column]:
    """The columns with x, y, z under these names, see ``axes_of``.

    Raises:
        MalformedData: as there.
    """
    by_file = {name: axis for axis, name in axes_of(format_name, columns).items()}
    return {by_file.get(name, name): column for name, column in columns.items()}

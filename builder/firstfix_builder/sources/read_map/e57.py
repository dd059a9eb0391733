"""E57: every scan by its pose into one cloud; the poses are where the scanner stood."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firstfix.errors import MalformedData
from firstfix.transform import from_quaternion

from .file_errors import foreign
from .headers import check_e57, check_points
from .map_data import MapData, finite_points
from .map_limits import LIMITS


def read_e57(path: Path) -> MapData:
    """Points marked invalid are left out. A scan without a pose lies in the file's frame as it is.

    Raises:
        MalformedData: no E57, cut off, or without a point.
        TooLarge: over the limits.
    """
    import pye57

    check_e57(path)
    with foreign("E57", path):
        # pye57 keeps the file open for as long as an object of it lives: it has no context manager.
        file = pye57.E57(str(path))
        try:
            headers = [file.get_header(index) for index in range(file.scan_count)]
            # Capacity for all of a scan's points is taken before the first is read.
            points = sum(int(header.point_count) for header in headers)
            LIMITS.check("E57", points, 8 * 4)
            check_points(path, points)
            clouds = [_scan_points(file, index) for index, header in enumerate(headers) if header.point_count]
            poses = [
                from_quaternion(header.translation, np.roll(np.asarray(header.rotation, np.float64), -1))
                for header in headers
                if header.has_pose()
            ]
        finally:
            file.close()
    if not clouds:
        raise MalformedData(f"E57: its {len(headers)} scans have no points")
    return MapData(
        points=finite_points(np.concatenate(clouds)),
        trajectory=np.stack(poses) if poses else None,
    )


def _scan_points(file: object, index: int) -> NDArray[np.float64]:
    data = file.read_scan(index, transform=True, ignore_missing_fields=True)  # type: ignore[attr-defined]
    return np.stack([data[f"cartesian{axis}"] for axis in "XYZ"], axis=1).astype(np.float64, copy=False)

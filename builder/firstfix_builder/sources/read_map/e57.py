"""E57: every scan by its pose into one cloud. Poses are stations where a scanner can have stood there."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix.errors import MalformedData
from firstfix.transform import Matrix

from ...mesh.intensity import Intensity, joined_intensity
from .file_errors import foreign
from .headers import check_e57, check_points
from .map_data import MapData, finite_rows
from .map_limits import LIMITS
from .rigid import rigid_from_quaternions
from .stations import Stations
from .what_was_read import WhatWasRead, plain

_AT_ONCE = 50_000


def read_e57(path: Path) -> MapData:
    """Points marked invalid are left out. A scan without a pose lies in the file's frame as it is.

    Raises:
        MalformedData: no E57, cut off, or without a point.
        TooLarge: over the limits.
    """
    import pye57

    check_e57(path)
    stations = Stations()
    names: list[str] = []
    brightness: list[Intensity | None] = []
    done = 0
    with foreign("E57", path):
        # pye57 keeps the file open for as long as an object of it lives: it has no context manager.
        file = pye57.E57(str(path))
        try:
            headers = [file.get_header(index) for index in range(file.scan_count)]
            # Capacity for all of a scan's points is taken before the first is read.
            points = sum(int(header.point_count) for header in headers)
            LIMITS.check("E57", points, 8 * 4)
            check_points(path, points)
            cloud = np.empty((points, 3))
            for index, header in enumerate(headers):
                if not header.point_count:
                    continue
                data = file.read_scan(index, intensity=True, transform=False, ignore_missing_fields=True)
                part = cloud[done : done + _read_points(data, cloud[done:])]
                done += len(part)
                if len(part):
                    brightness.append(Intensity.of(data.get("intensity")))
                del data
                T_map_scan = _pose_of(header)
                if T_map_scan is not None and len(part):
                    stations.add(T_map_scan, part)
                    _transform(T_map_scan, part)
                names.append(_text(header.node, "name") or f"scan {index}")
            georeference = _text(file.root, "coordinateMetadata")
            program = _text(file.root, "e57LibraryVersion")
        finally:
            file.close()
    if not done:
        raise MalformedData(f"E57: its {len(headers)} scans have no points")
    trajectory = stations.trajectory()
    intensity = joined_intensity(brightness)
    keep = finite_rows(cloud[:done])
    return MapData(
        points=cloud[:done] if keep.all() else cloud[:done][keep],
        intensity=None if intensity is None else intensity.at(keep),
        trajectory=trajectory,
        read=WhatWasRead(
            form="E57",
            program=program,
            unit="metre",
            georeference=georeference,
            clouds=tuple(names),
            poses="" if trajectory is None else "poses of its scans",
            left_out=stations.left_out(),
        ),
    )


def _read_points(data: Mapping[str, NDArray[Any]], out: NDArray[np.float64]) -> int:
    """Write a scan's valid points, in its own frame, to the first rows of ``out``; returns their number."""
    if "cartesianX" in data:
        columns = [data[f"cartesian{axis}"] for axis in "XYZ"]
    else:
        names = ("Range", "Azimuth", "Elevation")
        range_m, azimuth, elevation = (data[f"spherical{name}"] for name in names)
        level_m = range_m * np.cos(elevation)
        columns = [level_m * np.cos(azimuth), level_m * np.sin(azimuth), range_m * np.sin(elevation)]
    count = len(columns[0])
    for axis, column in enumerate(columns):
        out[:count, axis] = column
    return count


def _transform(T_map_scan: Matrix, points: NDArray[np.float64]) -> None:
    """Bring (n, 3) points from the scan's frame to the file's, in place.

    By columns: for a matrix of three columns BLAS starts threads, which cost more than they save.
    """
    if np.array_equal(T_map_scan, np.eye(4)):
        return
    for start in range(0, len(points), _AT_ONCE):
        some = points[start : start + _AT_ONCE]
        x, y, z = some.T.copy()
        for axis, (by_x, by_y, by_z, shift_m) in enumerate(T_map_scan[:3]):
            some[:, axis] = by_x * x + by_y * y + by_z * z + shift_m


def _pose_of(header: Any) -> Matrix | None:
    """T_map_scan by the names of its numbers, whatever their order; None: the scan has no pose.

    pye57 takes them in the file's order.
    """
    if not header.has_pose():
        return None
    pose = header["pose"]
    translation, rotation = np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0])
    if pose.isDefined("translation"):
        translation = np.array([pose["translation"][name].value() for name in "xyz"])
    if pose.isDefined("rotation"):
        rotation = np.array([pose["rotation"][name].value() for name in "xyzw"])
    length = max(float(np.linalg.norm(rotation)), 1e-9)  # writers round; a turn has a direction alone
    T: Matrix = rigid_from_quaternions(translation[None], rotation[None] / length)[0]
    return T


def _text(node: Any, name: str) -> str:
    """Text of a child, in one line; empty if there is none."""
    return plain(str(node[name].value())) if node.isDefined(name) else ""

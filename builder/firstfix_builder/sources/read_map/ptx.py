"""PTX, the text of registered scans (Leica Cyclone's export): a head of ten lines and the points, by scan.

columns, rows          two lines
station, its axes      four lines of three numbers: they repeat the matrix
matrix                 four lines of four numbers, transposed: the translation is the last
x y z intensity ...    columns * rows lines in the scan's frame; 0 0 0 where no light came back
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firstfix.errors import MalformedData
from firstfix.formats.text_table import parse_rows
from firstfix.transform import Matrix, transform_points

from ...mesh.intensity import Intensity, joined_intensity
from .map_data import MapData, finite_rows
from .map_limits import LIMITS
from .rigid import rigid_matrices
from .stations import Stations
from .text_lines import TextLines
from .what_was_read import LeftOut, WhatWasRead

_HEAD_LINES, _MATRIX_AT = 10, 6
_MAX_DIGITS = 9


def read_ptx(path: Path) -> MapData:
    """All scans in the file's frame. A pose is a station where a scanner can have stood there.

    Raises:
        MalformedData: a head is damaged, or fewer points follow than it says.
        TooLarge: over the limits.
    """
    lines = TextLines(path.read_bytes())
    stations = Stations()
    clouds: list[NDArray[np.float64]] = []
    brightness: list[Intensity | None] = []
    at = scans = total = without = 0
    while at < len(lines):
        scans += 1
        count, T_map_scan = _head(lines, at, scans)
        total += count
        LIMITS.check("PTX", total, 8 * 4)
        at += _HEAD_LINES
        if count > len(lines) - at:
            raise MalformedData(
                f"PTX: the file is cut off: {len(lines) - at} of {count} points of scan {scans}"
            )
        columns = range(4 if count and len(lines.words(at)) > 3 else 3)
        rows = parse_rows("PTX", lines.span(at, count), columns=columns) if count else np.empty((0, 3))
        if len(rows) != count:
            raise MalformedData(f"PTX: {len(rows)} of {count} points of scan {scans}")
        at += count
        rows = rows[rows[:, :3].any(axis=1)]
        points = np.ascontiguousarray(rows[:, :3])
        without += count - len(points)
        if len(points):
            keep = finite_rows(points)
            points = points[keep]
            stations.add(T_map_scan, points)
            clouds.append(transform_points(T_map_scan, points))
            brightness.append(Intensity.of(rows[:, 3], keep) if rows.shape[1] > 3 else None)
    if not clouds:
        raise MalformedData(f"PTX: its {scans} scans have no points")
    trajectory = stations.trajectory()
    read = WhatWasRead(
        form="PTX",
        unit="metre",
        clouds=tuple(f"scan {number}" for number in range(len(clouds))),
        poses="" if trajectory is None else "poses of its scans",
        left_out=stations.left_out(),
    )
    return MapData(
        points=np.concatenate(clouds),
        intensity=joined_intensity(brightness),
        trajectory=trajectory,
        read=read.without(LeftOut("points", "0 0 0: no light came back", without)),
    )


def _head(lines: TextLines, at: int, scan: int) -> tuple[int, Matrix]:
    """Number of points and T_map_scan of a scan."""
    if len(lines) - at < _HEAD_LINES:
        raise MalformedData(f"PTX: the file is cut off in the head of scan {scan}")
    sizes = [lines.words(at), lines.words(at + 1)]
    if not all(len(one) == 1 and one[0].isdigit() and len(one[0]) <= _MAX_DIGITS for one in sizes):
        raise MalformedData(f"PTX: scan {scan} does not begin with its numbers of columns and of rows")
    matrix = parse_rows("PTX", lines.span(at + _MATRIX_AT, 4))
    if matrix.shape != (4, 4):
        raise MalformedData(f"PTX: scan {scan} has no 4x4 matrix in the lines 7 to 10 of its head")
    T: Matrix = rigid_matrices(matrix.T[None])[0]
    return int(sizes[0][0]) * int(sizes[1][0]), T

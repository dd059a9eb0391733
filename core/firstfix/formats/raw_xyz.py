"""Decoder of raw little-endian float32 rows: x, y, z (``xyz``), or with intensity (``xyzi``, KITTI)."""

from __future__ import annotations

import numpy as np

from ..errors import MalformedData
from .point_cloud import Body, Limits, PointCloud


def decode_xyz(body: Body, limits: Limits) -> PointCloud:
    """Decode rows of 12 bytes.

    Raises:
        MalformedData: empty, or not a whole number of rows.
        TooLarge: over the limits.
    """
    return _decode(body, ("x", "y", "z"), limits)


def decode_xyzi(body: Body, limits: Limits) -> PointCloud:
    """Decode rows of 16 bytes.

    Raises:
        MalformedData: empty, or not a whole number of rows.
        TooLarge: over the limits.
    """
    return _decode(body, ("x", "y", "z", "intensity"), limits)


def _decode(body: Body, names: tuple[str, ...], limits: Limits) -> PointCloud:
    format_name, row_bytes = f"raw {' '.join(names)}", 4 * len(names)
    if not len(body):
        raise MalformedData(f"{format_name}: the data is empty (0 bytes)")
    if len(body) % row_bytes:
        raise MalformedData(
            f"{format_name}: {len(body)} bytes are not a whole number of rows of {row_bytes} bytes"
        )
    limits.check(format_name, len(body) // row_bytes, row_bytes)
    rows = np.frombuffer(body, "<f4").reshape(-1, len(names))
    return PointCloud({name: rows[:, column] for column, name in enumerate(names)})

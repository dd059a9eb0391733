"""Raw little-endian float32 rows: x, y, z (``xyz``), or x, y, z, intensity (``xyzi``, KITTI's .bin)."""

from __future__ import annotations

import numpy as np

from ..errors import MalformedData
from .point_cloud import Body, Limits, PointCloud


def decode_xyz(body: Body, limits: Limits) -> PointCloud:
    """Rows of 12 bytes. Raises MalformedData (no whole number of rows, or none) or TooLarge."""
    return _decode(body, ("x", "y", "z"), limits)


def decode_xyzi(body: Body, limits: Limits) -> PointCloud:
    """Rows of 16 bytes. Raises MalformedData (no whole number of rows, or none) or TooLarge."""
    return _decode(body, ("x", "y", "z", "intensity"), limits)


def _decode(body: Body, names: tuple[str, ...], limits: Limits) -> PointCloud:
    format_name, row_bytes = f"raw {' '.join(names)}", 4 * len(names)
    if not len(body):
        raise MalformedData(f"{format_name}: the data is empty (0 bytes)")
    if len(body) % row_bytes:
        raise MalformedData(f"{format_name}: {len(body)} bytes are not rows of {row_bytes} bytes")
    limits.check(format_name, len(body) // row_bytes, row_bytes)
    rows = np.frombuffer(body, "<f4").reshape(-1, len(names))
    return PointCloud({name: rows[:, column] for column, name in enumerate(names)})

"""The points of a recorded query's body, as viewers show them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from firstfix.formats.point_cloud import Body
from firstfix.scan.compact import CompactScan, ScanDescriptor
from firstfix.scan.scan import Scan
from firstfix.scan.sequence import AnyScan
from firstfix.transform import transform_points

if TYPE_CHECKING:
    from firstfix_service.query_workers.look import Look

NO_POINTS = np.zeros((0, 3), np.float32)
_STAMP = np.dtype("<f8")
_NUMBER = np.dtype("<f4")


@dataclass(frozen=True)
class ShownScan:
    """A scan, or what stands in its place.

    Attributes:
        points: (n, 3) float32 in the sensor frame, of several scans in the frame of the last.
        stamp_s: as the sensor's driver gave it; None: it gave none.
        unreadable: why there are no points; empty: the points were read.
    """

    points: NDArray[np.float32]
    stamp_s: float | None = None
    unreadable: str = ""

    @classmethod
    def of(cls, scan: AnyScan) -> ShownScan:
        """The points of a decoded query."""
        return cls(points_of(scan), scan.stamp_s if isinstance(scan, Scan) else None)

    def packed(self) -> bytes:
        """The stamp as float64, NaN without one, then x, y, z of each point as float32; little-endian."""
        stamp = np.array(np.nan if self.stamp_s is None else self.stamp_s, _STAMP)
        return stamp.tobytes() + np.ascontiguousarray(self.points, _NUMBER).tobytes()

    @classmethod
    def unpacked(cls, data: bytes) -> ShownScan:
        """The scan that ``packed`` gave."""
        stamp_s = float(np.frombuffer(data, _STAMP, 1)[0])
        points = np.frombuffer(data, _NUMBER, offset=_STAMP.itemsize).reshape(-1, 3)
        return cls(points, None if np.isnan(stamp_s) else stamp_s)


def points_of(scan: AnyScan) -> NDArray[np.float32]:
    """The (n, 3) points of a query in the sensor frame, of several scans in the frame of the last."""
    if isinstance(scan, ScanDescriptor):
        return NO_POINTS
    if isinstance(scan, Scan | CompactScan):
        return scan.points
    moved = [
        transform_points(T, one.points).astype(np.float32)
        for one, T in zip(scan.scans[:-1], scan.T_last_scan[:-1], strict=True)
    ]
    return np.concatenate([*moved, scan.scans[-1].points])


def shown(look: Look, body: Body) -> bytes:
    """A scan as ``ShownScan.packed``: the work of a worker process.

    Args:
        body: without its content encoding.

    Raises:
        InputError: the body cannot be used.
    """
    return ShownScan.of(look.body_format.decode(body)).packed()

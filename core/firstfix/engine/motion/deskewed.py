"""Deskewing by a motion that the caller knows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidOption
from ...native import deskew
from ...scan.compact import CompactScan
from ...scan.range_view import nearest_by_direction
from ...scan.scan import Scan
from ...scan.sequence import ScanSequence
from ...scan.voxel_filter import TimedPoints
from .timed_view import timed_view


def deskewed(sequence: ScanSequence, twist: NDArray[np.float64] | None) -> ScanSequence:
    """The sequence with its last scan as it would have been seen at its stamp. None changes nothing.

    The other scans stay as they are: the twist is that of the last one.

    Args:
        twist: (6,) m/s then rad/s, in the sensor frame.

    Raises:
        InvalidOption: the times of the points are not known.
    """
    if twist is None:
        return sequence
    last = sequence.scans[-1]
    if last.time_s is None:
        raise InvalidOption("a twist needs the times of the scan's points")
    motion = np.asarray(twist, np.float64)
    still: Scan | CompactScan = replace(last, points=deskew(last.points, last.time_s, motion), time_s=None)
    if isinstance(last, CompactScan) and isinstance(still, CompactScan):
        returns = timed_view(TimedPoints(last.points, last.time_s), last.nearest_m)
        assert returns.time_s is not None
        moved = deskew(returns.points, returns.time_s, motion)
        still = replace(still, nearest_m=nearest_by_direction(moved))
    return ScanSequence((*sequence.scans[:-1], still), sequence.T_last_scan)

"""Deskewing by a motion that the caller knows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidOption
from ..native import deskew
from ..scan.compact import CompactScan
from ..scan.scan import Scan
from ..scan.sequence import ScanSequence


def deskewed(sequence: ScanSequence, twist: NDArray[np.float64] | None) -> ScanSequence:
    """The sequence with its last scan as it would have been seen at its stamp. None changes nothing.

    The other scans stay as they are: the twist is that of the last one. The ranges by direction of a compact
    scan have no times, so they stay as they are too.

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
    still: Scan | CompactScan = replace(
        last, points=deskew(last.points, last.time_s, np.asarray(twist, np.float64)), time_s=None
    )
    return ScanSequence((*sequence.scans[:-1], still), sequence.T_last_scan)

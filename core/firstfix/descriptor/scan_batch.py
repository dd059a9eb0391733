"""Batch of levelled scans, the input of every descriptor. One scan is a batch of one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class ScanBatch:
    """Points of n scans in their levelled sensor frames (z up, origin at the sensor).

    Attributes:
        points: (p, 3) float32 metres, scan after scan.
        start: (n + 1,) scan i holds ``points[start[i]:start[i + 1]]``.
        height_m: (n,) float32 height of each sensor above its floor.
    """

    points: NDArray[np.float32]
    start: NDArray[np.intp]
    height_m: NDArray[np.float32]

    @classmethod
    def single(cls, points: NDArray[np.float32], height_m: float) -> ScanBatch:
        """Batch of one scan."""
        return cls(points, np.array([0, len(points)], np.intp), np.array([height_m], np.float32))

    def __len__(self) -> int:
        return len(self.height_m)

    @property
    def scan_of_point(self) -> NDArray[np.intp]:
        """(p,) number of the scan that each point belongs to."""
        return np.repeat(np.arange(len(self)), np.diff(self.start))

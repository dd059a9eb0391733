"""Which poses that a file gives its scans say where a scanner stood.

A pose in E57 or PTX brings a scan's numbers to the file's frame. In merged and exported files it is the
identity or a shift of all coordinates, and no scanner stood at its origin.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from firstfix.transform import Matrix

from .what_was_read import LeftOut

LEAST_RANGE_M = 0.3  # no scanner that stands on a tripod or a robot measures nearer
NEAR_POINTS = 3  # fewer are noise
_SAME = 1e-6

_IDENTITY = "the identity, which merged files have"
_SHIFT = "no turn, and a shift: it tells where the coordinates begin"
_SHARED = "all scans have the same"
_OUTSIDE = "outside the scan's own points: no scanner stood there"
_NEAR = f"points lie within {LEAST_RANGE_M} m of it: no scanner stood there"


@dataclass
class Stations:
    """Poses of the scans of a file, each judged by its scan's points."""

    _judged: list[tuple[Matrix, str]] = field(default_factory=list)

    def add(self, T_map_scan: Matrix, points: NDArray[np.float64]) -> None:
        """Judge a pose by the (n, 3) points of its scan, in the scan's own frame, metres."""
        self._judged.append((T_map_scan, why_no_station(points)))

    def trajectory(self) -> NDArray[np.float64] | None:
        """(m, 4, 4) T_map_sensor of the poses that are stations; None if none is."""
        kept = [T for T, reason in self._reasons() if not reason]
        return np.stack(kept) if kept else None

    def left_out(self) -> tuple[LeftOut, ...]:
        """Poses that are no stations, by their reasons."""
        counted = Counter(reason for _, reason in self._reasons() if reason)
        return tuple(LeftOut("poses of scans", reason, count) for reason, count in counted.items())

    def _reasons(self) -> list[tuple[Matrix, str]]:
        common = self._common()
        return [(T, common or reason) for T, reason in self._judged]

    def _common(self) -> str:
        """Reason why the poses of all scans tell nothing; empty if they may."""
        poses = np.array([T for T, _ in self._judged]).reshape(-1, 4, 4)
        if not len(poses):
            return ""
        is_same = np.abs(poses - poses[0]).max() <= _SAME
        if is_same and np.abs(poses[0] - np.eye(4)).max() <= _SAME:
            return _IDENTITY
        if is_same and len(poses) > 1:
            return _SHARED
        shifts = poses.copy()
        shifts[:, :3, :3] = np.eye(3)
        if len(poses) > 1:  # of several stations by whole metres; of one alone nobody knows more
            shifts[:, :3, 3] = shifts[:, :3, 3].round()
        return _SHIFT if np.abs(poses - shifts).max() <= _SAME else ""


def why_no_station(points: NDArray[np.float64]) -> str:
    """Reason why no scanner stood at the origin of (n, 3) points; empty if one may have."""
    low = np.array([np.fmin.reduce(points[:, axis]) for axis in range(3)])  # whatever is NaN
    high = np.array([np.fmax.reduce(points[:, axis]) for axis in range(3)])
    # Within its least range of a scan's edge no scanner stands; outdoors nothing may be above it.
    if (low > -LEAST_RANGE_M).any() or (high[:2] < LEAST_RANGE_M).any():
        return _OUTSIDE
    some = points
    for axis in range(3):
        some = some[np.abs(some[:, axis]) < LEAST_RANGE_M]
    range_m = np.linalg.norm(some, axis=1)
    # rays without a return are written as zeros
    return _NEAR if ((range_m > 0) & (range_m < LEAST_RANGE_M)).sum() >= NEAR_POINTS else ""

"""Several scans taken along a robot's way: together they resolve what one scan leaves ambiguous."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidScan, TooLarge
from ..transform import Matrix, inverse, product
from .compact import CompactScan, ScanDescriptor
from .scan import MAX_POINTS, Scan

MAX_SCANS = 16
MAX_WAY_M = 1_000.0
MAX_ODOMETRY_M = 1e8  # from its frame's origin: further away differences lose their millimetres


@dataclass(frozen=True)
class ScanSequence:
    """Scans in the order in which they were taken. The answer is the pose of the last scan's sensor.

    Attributes:
        scans: 1 to MAX_SCANS.
        T_last_scan: (4, 4) for each scan: its sensor's pose in the last scan's frame, by odometry.
    """

    scans: tuple[Scan | CompactScan, ...]
    T_last_scan: tuple[Matrix, ...]

    @classmethod
    def single(cls, scan: Scan | CompactScan) -> ScanSequence:
        """Sequence of one scan."""
        return cls((scan,), (np.eye(4),))

    @classmethod
    def along(
        cls, scans: Sequence[Scan | CompactScan], T_odom_sensor: Sequence[NDArray[np.floating]]
    ) -> ScanSequence:
        """Sequence from the sensor's poses in one fixed frame, for example the odometry frame.

        Raises:
            InvalidScan: no scans, another number of poses, a pose that is no rigid transform or lies beyond
                MAX_ODOMETRY_M, or a scan over MAX_WAY_M from the last.
            TooLarge: over MAX_SCANS scans or MAX_POINTS points.
        """
        poses = [np.asarray(T, np.float64) for T in T_odom_sensor]
        if not scans or len(scans) != len(poses):
            raise InvalidScan(
                f"a sequence needs one pose for each scan: {len(scans)} scans, {len(poses)} poses"
            )
        if len(scans) > MAX_SCANS:
            raise TooLarge(f"a sequence holds up to {MAX_SCANS} scans, not {len(scans)}")
        if (total := sum(len(scan) for scan in scans)) > MAX_POINTS:
            raise TooLarge(f"the scans have {total} points together, the limit is {MAX_POINTS}")
        for number, T in enumerate(poses):
            if not _is_rigid(T):
                raise InvalidScan(f"pose {number} of the sequence is not a rigid transform")
            if np.abs(T[:3, 3]).max() > MAX_ODOMETRY_M:
                raise InvalidScan(f"pose {number} of the sequence lies beyond {MAX_ODOMETRY_M:g} m")
        T_last_odom = inverse(poses[-1])
        T_last_scan = tuple(product(T_last_odom, T) for T in poses)
        if any(np.linalg.norm(T[:3, 3]) > MAX_WAY_M for T in T_last_scan):
            raise InvalidScan(f"a scan of the sequence lies over {MAX_WAY_M:g} m from the last")
        return cls(tuple(scans), T_last_scan)

    def __len__(self) -> int:
        return len(self.scans)


AnyScan: TypeAlias = "Scan | ScanSequence | CompactScan | ScanDescriptor"
"""Everything that one query may hold."""


def _is_rigid(T: NDArray[np.float64]) -> bool:
    if T.shape != (4, 4) or not np.isfinite(T).all() or not np.array_equal(T[3], [0, 0, 0, 1]):
        return False
    R = T[:3, :3]
    return bool(np.allclose(R @ R.T, np.eye(3), atol=1e-4) and np.linalg.det(R) > 0)

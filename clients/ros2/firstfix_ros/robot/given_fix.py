"""A fix that a robot was given, with its epoch; in JSON it outlives the gateway."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from firstfix.ros.header import Stamp
from firstfix.transform import Matrix, inverse, pose_from_mapping, pose_to_mapping

from .epoch import Epoch
from .query import Fix

_FORMAT = 1


@dataclass(frozen=True)
class GivenFix:
    """A fix that was wanted and found.

    Attributes:
        map_id: map whose frame the pose is in.
    """

    epoch: Epoch
    map_id: str
    fix: Fix

    def carried_to(self, T_odom_frame: Matrix | None) -> Matrix | None:
        """The pose (4, 4) of the frame after the motion of the odometry since; None if not known.

        Args:
            T_odom_frame: (4, 4) pose of the same frame by the same odometry, now.
        """
        if self.fix.T_odom_frame is None or T_odom_frame is None:
            return None
        return self.fix.T_map_frame @ inverse(self.fix.T_odom_frame) @ T_odom_frame

    def to_mapping(self) -> dict[str, Any]:
        """Values ready for JSON."""
        fix = self.fix
        return {
            "format": _FORMAT,
            "robot": self.epoch.robot,
            "map_id": self.map_id,
            "map_version": self.epoch.map_version,
            "number": self.epoch.number,
            "frame": fix.frame,
            "stamp_ns": fix.stamp.ns,
            "T_map_frame": pose_to_mapping(fix.T_map_frame),
            "covariance": fix.covariance.ravel().tolist(),
            "T_odom_frame": None if fix.T_odom_frame is None else pose_to_mapping(fix.T_odom_frame),
        }

    @classmethod
    def from_mapping(cls, data: Mapping[str, Any]) -> GivenFix:
        """Read what ``to_mapping`` returned.

        Raises:
            KeyError, TypeError, ValueError: not such a mapping.
        """
        if data["format"] != _FORMAT:
            raise ValueError(f"format {data['format']!r} is not known")
        covariance = np.asarray(data["covariance"], np.float64).reshape(6, 6)
        odom = data["T_odom_frame"]
        fix = Fix(
            str(data["frame"]),
            Stamp.of_ns(int(data["stamp_ns"])),
            pose_from_mapping(data["T_map_frame"]),
            covariance,
            None if odom is None else pose_from_mapping(odom),
        )
        numbers = [fix.T_map_frame, covariance, *([] if fix.T_odom_frame is None else [fix.T_odom_frame])]
        if not all(np.isfinite(one).all() for one in numbers):
            raise ValueError("a number is not finite")
        epoch = Epoch(str(data["robot"]), str(data["map_version"]), int(data["number"]))
        return cls(epoch, str(data["map_id"]), fix)

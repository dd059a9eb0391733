"""Decoder of geometry_msgs/PoseWithCovarianceStamped: a pose of the robot's own localization."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from firstfix.ros.cdr import MessageReader
from firstfix.ros.header import Header, read_header
from firstfix.transform import Matrix, from_quaternion


@dataclass(frozen=True)
class OwnPose:
    """Pose (4, 4) of the robot's base in the header's frame, at the header's stamp."""

    header: Header
    T_map_base: Matrix


def decode_own_pose(body: bytes | memoryview) -> OwnPose:
    """Decode the header and the pose. The covariance is not used.

    Raises:
        MalformedData: not such a message, or not a pose.
        UnsupportedFormat: not plain CDR.
    """
    reader = MessageReader("PoseWithCovarianceStamped", body)
    header = read_header(reader)
    numbers = reader.floats(7)
    reader.floats(36)
    reader.end()
    try:
        T = from_quaternion(numbers[:3], numbers[3:])
    except ValueError as error:
        reader.fail(str(error))
    if not np.isfinite(T).all():
        reader.fail("a position is not finite")
    return OwnPose(header, T)

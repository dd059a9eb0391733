"""Encoder of an answer as geometry_msgs/PoseWithCovarianceStamped, for nav2, AMCL and robot_localization."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..answer.localization import Localization
from ..transform import Matrix, quaternion_of
from .cdr import CdrWriter
from .header import Header, Stamp, write_header

TYPE = "geometry_msgs/msg/PoseWithCovarianceStamped"
MAP_FRAME = "map"  # REP-105


def to_pose_cdr(answer: Localization, stamp: Stamp, frame_id: str = MAP_FRAME) -> bytes:
    """Encode a localized answer as little-endian CDR.

    The pose is the robot's (``T_map_base``) if the query had the mounting of the sensor, otherwise the
    sensor's. The covariance belongs to the same pose: row-major over x, y, z and rotations about the frame's
    x, y, z axes, in ROS's order.

    Raises:
        ValueError: the answer is not localized, so there is no message for it.
    """
    if answer.T_map_sensor is None or answer.covariance is None:
        raise ValueError("only a localized answer has a pose")
    T, covariance = answer.T_map_sensor, answer.covariance
    if answer.T_map_base is not None:
        T, covariance = answer.T_map_base, covariance_of_base(T, answer.T_map_base, covariance)
    return encode_pose(T, covariance, Header(stamp, frame_id))


def encode_pose(T: Matrix, covariance: NDArray[np.float64], header: Header) -> bytes:
    """Encode a (4, 4) pose in the header's frame, with its (6, 6) covariance, as little-endian CDR."""
    writer = CdrWriter()
    write_header(writer, header)
    writer.numbers("d", [*T[:3, 3], *quaternion_of(T), *covariance.ravel()])
    return writer.bytes()


def covariance_of_base(
    T_map_sensor: Matrix, T_map_base: Matrix, covariance: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The (6, 6) covariance of the robot's pose.

    A rotation about the sensor moves the origin of the robot.
    """
    x, y, z = T_map_base[:3, 3] - T_map_sensor[:3, 3]
    J = np.eye(6)
    J[:3, 3:] = [[0, z, -y], [-z, 0, x], [y, -x, 0]]  # rotation x arm = -[arm]x rotation
    moved: NDArray[np.float64] = J @ covariance @ J.T
    return (moved + moved.T) / 2

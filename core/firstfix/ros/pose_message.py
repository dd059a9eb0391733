"""geometry_msgs/PoseWithCovarianceStamped of an answer, as nav2, AMCL and robot_localization take it."""

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
    """The message, little-endian CDR.

    The pose is the robot's (``T_map_base``) where the query said how the sensor is mounted, else the
    sensor's; the covariance belongs to that same pose, row-major over x, y, z and rotations about the
    frame's x, y, z axes, in ROS's order.

    Raises:
        ValueError: the answer is not localized: there is no message for it.
    """
    if answer.T_map_sensor is None or answer.covariance is None:
        raise ValueError("only a localized answer has a pose")
    T, covariance = answer.T_map_sensor, answer.covariance
    if answer.T_map_base is not None:
        T, covariance = answer.T_map_base, covariance_of_base(T, answer.T_map_base, covariance)
    writer = CdrWriter()
    write_header(writer, Header(stamp, frame_id))
    writer.numbers("d", [*T[:3, 3], *quaternion_of(T), *covariance.ravel()])
    return writer.bytes()


def covariance_of_base(
    T_map_sensor: Matrix, T_map_base: Matrix, covariance: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(6, 6) of the robot's pose from the sensor's: a turn about the sensor moves the robot's origin."""
    x, y, z = T_map_base[:3, 3] - T_map_sensor[:3, 3]
    J = np.eye(6)
    J[:3, 3:] = [[0, z, -y], [-z, 0, x], [y, -x, 0]]  # turn x arm = -[arm]x turn
    moved: NDArray[np.float64] = J @ covariance @ J.T
    return (moved + moved.T) / 2

"""A localizer that waits for a pose and then tracks by the robot's odometry, as map -> odom in /tf."""

from __future__ import annotations

from typing import Any

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.node import Node
from rclpy.qos import QoSProfile
from tf2_msgs.msg import TFMessage

from firstfix.transform import Matrix, inverse
from plugins.fleet.tests.robots.stand_ins.robot import LOOK_S, Robot, pose_of

HISTORY_S = 10.0  # of a tf2 buffer


class Localizer(Node):
    """What the localizers have in common.

    Attributes:
        got: poses that were taken, with the pose that they were taken to mean now.
    """

    def __init__(
        self, name: str, robot: Robot, *, topic: str = "initialpose", depth: int = 10, ahead_s: float = 0.0
    ) -> None:
        super().__init__(name, namespace=robot.get_namespace(), context=robot.context)
        self.robot, self._ahead_s = robot, ahead_s
        self.T_map_odom: Matrix | None = None
        self.got: list[PoseWithCovarianceStamped] = []
        self._odometry: list[tuple[int, Matrix]] = []
        self._moving = self.create_publisher(TFMessage, "tf", 100)
        self._subscription = self.create_subscription(
            PoseWithCovarianceStamped, topic, self.on_pose, QoSProfile(depth=depth)
        )
        self.create_timer(LOOK_S, self._look)

    @property
    def error_m(self) -> float:
        """Distance from the true pose to the pose by this localizer."""
        if self.T_map_odom is None:
            return float("inf")
        T = self.T_map_odom @ self.robot.T_odom_base
        return float(np.linalg.norm(T[:3, 3] - self.robot.T_map_base[:3, 3]))

    def on_pose(self, message: Any) -> None:
        """Takes a pose."""
        if message.header.frame_id == "map":
            self.start(message, self.robot.T_odom_base)

    def start(self, message: Any, T_odom_base: Matrix) -> None:
        """Starts from a pose which the robot had where the odometry said ``T_odom_base``."""
        self.got.append(message)
        self.T_map_odom = pose_of(message) @ inverse(T_odom_base)

    def odometry_at(self, stamp_ns: int) -> Matrix | None:
        """The odometry at a time; None if it is older than this node, or than a tf2 buffer keeps."""
        if not self._odometry or stamp_ns < self._odometry[0][0]:
            return None
        return min(self._odometry, key=lambda one: abs(one[0] - stamp_ns))[1]

    def _look(self) -> None:
        now_ns = self.get_clock().now().nanoseconds
        self._odometry.append((now_ns, self.robot.T_odom_base))
        self._odometry = [one for one in self._odometry if now_ns - one[0] <= HISTORY_S * 1e9]
        if self.T_map_odom is not None:
            sent = self.robot.transform("map", "odom", self.T_map_odom, self._ahead_s)
            self._moving.publish(TFMessage(transforms=[sent]))

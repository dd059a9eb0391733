"""A robot in rclpy that drives along its odometry's x axis. Clouds name the pose where they were taken."""

from __future__ import annotations

import array
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import PointCloud2, PointField
from tf2_msgs.msg import TFMessage

from firstfix.answer.localization import Localization, Verdict
from firstfix.transform import Matrix, from_quaternion, make_transform, quaternion_of, rotation_z

T_MAP_ODOM = make_transform(rotation_z(0.7), [12.0, -4.0, 0.0])
T_BASE_LIDAR = make_transform(np.eye(3), [0.2, 0.0, 0.9])
FIRST_POINTS = 100  # a cloud is named by the number of its points: so many numbers, which come again
LOOK_S, CLOUD_EVERY = 0.1, 2
SPACING_M = 2.0  # of the points: thinning them changes nothing


class Robot(Node):
    """The robot of a namespace, with odometry in /tf or without.

    Attributes:
        speed_m_s: of the robot along x of its odometry.
    """

    def __init__(
        self,
        namespace: str,
        context: Any,
        *,
        odometry: bool = True,
        points: str = "points",
        first_points: int = FIRST_POINTS,
    ) -> None:
        super().__init__("robot", namespace=namespace, context=context)
        self.speed_m_s, self.way_m = 0.0, 0.0
        self.odometry, self._first_points = odometry, first_points
        self.taken: dict[int, Matrix] = {}  # true pose of the LiDAR by the number of points
        self._looks = 0
        self._moving = self.create_publisher(TFMessage, "tf", 100)
        fixed = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._fixed = self.create_publisher(TFMessage, "tf_static", fixed)
        self._fixed.publish(TFMessage(transforms=[self.transform("base_link", "lidar", T_BASE_LIDAR)]))
        self._clouds = self.create_publisher(PointCloud2, points, qos_profile_sensor_data)
        self.create_timer(LOOK_S, self._look)

    @property
    def T_odom_base(self) -> Matrix:
        return make_transform(np.eye(3), [self.way_m, 0.0, 0.0])

    @property
    def T_map_base(self) -> Matrix:
        """The true pose."""
        return T_MAP_ODOM @ self.T_odom_base

    def transform(self, parent: str, child: str, T: Matrix, ahead_s: float = 0.0) -> TransformStamped:
        message = TransformStamped()
        ns = self.get_clock().now().nanoseconds + round(ahead_s * 1e9)
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(ns, 10**9)
        message.header.frame_id, message.child_frame_id = parent, child
        place, turn = message.transform.translation, message.transform.rotation
        place.x, place.y, place.z = T[:3, 3].tolist()
        turn.x, turn.y, turn.z, turn.w = map(float, quaternion_of(T))
        return message

    def _look(self) -> None:
        self.way_m += self.speed_m_s * LOOK_S
        if self.odometry:
            self._moving.publish(
                TFMessage(transforms=[self.transform("odom", "base_link", self.T_odom_base)])
            )
        if self._looks % CLOUD_EVERY == 0:
            self._clouds.publish(self._cloud(self._first_points + self._looks // CLOUD_EVERY % FIRST_POINTS))
        self._looks += 1

    def _cloud(self, points: int) -> PointCloud2:
        self.taken[points] = self.T_map_base @ T_BASE_LIDAR
        places = np.zeros((points, 3), np.float32)
        places[:, 0], places[:, 1] = np.divmod(np.arange(points), 25)
        message = PointCloud2(height=1, width=points, point_step=12, row_step=12 * points, is_dense=True)
        message.header.stamp = self.get_clock().now().to_msg()
        message.header.frame_id = "lidar"
        message.fields = [
            PointField(name=name, offset=4 * n, datatype=PointField.FLOAT32, count=1)
            for n, name in enumerate("xyz")
        ]
        message.data = array.array("B", (places * SPACING_M).astype(np.float32).tobytes())
        return message


class Answers(Mapping[int, Localization]):
    """What a service answers for the robot's clouds: the pose where they were taken."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot

    def __getitem__(self, points: int) -> Localization:
        T = self._robot.taken[points]
        covariance = np.diag([1e-4] * 3 + [1e-5] * 3)
        return Localization(
            Verdict.LOCALIZED,
            (),
            T,
            T @ np.linalg.inv(T_BASE_LIDAR),
            covariance,
            0.99,
            map_id="hall",
            map_version="ab" * 32,
        )

    def __iter__(self) -> Iterator[int]:
        return iter(self._robot.taken)

    def __len__(self) -> int:
        return len(self._robot.taken)


def pose_of(message: Any) -> Matrix:
    """The (4, 4) pose of a geometry_msgs/PoseWithCovarianceStamped."""
    p, q = message.pose.pose.position, message.pose.pose.orientation
    return from_quaternion([p.x, p.y, p.z], [q.x, q.y, q.z, q.w])

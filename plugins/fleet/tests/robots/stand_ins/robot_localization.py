"""robot_localization: a filter in the map's frame is set by the topic ``set_pose``.

Read in cra-ros-pkg/robot_localization, ``src/ros_filter.cpp`` (``loadParams``, ``setPoseCallback``): a
subscription with ``rclcpp::QoS(1)``; the pose is brought into the filter's world frame by tf, and its
covariance is taken over. The service ``set_pose`` (``robot_localization/srv/SetPose``) does the same and is
not stood in for.
"""

from __future__ import annotations

from plugins.fleet.tests.robots.stand_ins.localizer import Localizer
from plugins.fleet.tests.robots.stand_ins.robot import Robot


class EkfNode(Localizer):
    """``ekf_node`` with ``world_frame: map``, which publishes map -> odom."""

    def __init__(self, robot: Robot) -> None:
        super().__init__("ekf_filter_node_map", robot, topic="set_pose", depth=1)

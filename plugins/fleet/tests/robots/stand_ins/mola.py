"""MOLA: the ROS 2 bridge relocalizes its modules near the pose of a topic.

Read in MOLAorg/mola, ``mola_bridge_ros2/src/BridgeROS2.cpp`` (``ros_node_thread_main``,
``callbackOnRelocalizeTopic``): the topic is ``relocalize_from_topic``, by default ``/initialpose``, with the
default quality of service. Stamp and frame are not looked at.
"""

from __future__ import annotations

from typing import Any

from plugins.fleet.tests.robots.stand_ins.localizer import Localizer
from plugins.fleet.tests.robots.stand_ins.robot import Robot


class MolaBridge(Localizer):
    """The bridge, with an odometry module that relocalizes."""

    def __init__(self, robot: Robot) -> None:
        super().__init__("mola_bridge_ros2", robot)

    def on_pose(self, message: Any) -> None:
        self.start(message, self.robot.T_odom_base)

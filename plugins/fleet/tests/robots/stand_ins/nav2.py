"""Nav2: AMCL, and the node of a behaviour tree that asks for a new global localization.

Read in ros-navigation/navigation2, ``nav2_amcl/src/amcl_node.cpp`` (``initPubSub``, ``initialPoseReceived``,
``handleInitialPose``) and ``nav2_behavior_tree/plugins/action/reinitialize_global_localization_service.cpp``.
"""

from __future__ import annotations

from typing import Any

from std_srvs.srv import Empty

from firstfix.transform import inverse, make_transform, rotation_z, yaw_of
from plugins.fleet.tests.robots.stand_ins.localizer import Localizer
from plugins.fleet.tests.robots.stand_ins.robot import Robot, pose_of


class Amcl(Localizer):
    """AMCL: the default quality of service. It knows no height and dates its transform 1 s ahead.

    It moves a pose of the past on by the odometry since, if its tf2 buffer reaches back so far. If not, it
    takes the pose as it is.
    """

    def __init__(self, robot: Robot) -> None:
        super().__init__("amcl", robot, ahead_s=1.0)

    def on_pose(self, message: Any) -> None:
        if message.header.frame_id != "map":
            return
        stamp = message.header.stamp
        then, now = self.odometry_at(stamp.sec * 10**9 + stamp.nanosec), self.robot.T_odom_base
        self.start(message, now if then is None else then)
        assert self.T_map_odom is not None
        T = pose_of(message) @ (inverse(now if then is None else then) @ now)
        flat = make_transform(rotation_z(yaw_of(T)), [*T[:2, 3], 0.0])
        self.T_map_odom = flat @ inverse(now)


def reinitialize_global_localization(robot: Robot, service_name: str) -> Any:
    """What the behaviour tree's node does: it calls a service of type Empty. Returns the future."""
    client = robot.create_client(Empty, service_name)
    assert client.wait_for_service(200)
    return client.call_async(Empty.Request())

"""Messages that a gateway takes and publishes, with their ROS types and topics."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from firstfix.ros import imu, point_cloud2, pose_message, tf_message

from ..messages import diagnostic_array, pose_array

NODE_NAME = "first_fix"
RELOCALIZE = f"{NODE_NAME}/relocalize"  # std_srvs/srv/Trigger
REINITIALIZE = f"{NODE_NAME}/reinitialize_global_localization"  # std_srvs/srv/Empty


class Input(Enum):
    """Messages that a robot's gateway hears, with their ROS types."""

    CLOUD = ("points", point_cloud2.TYPE)
    IMU = ("imu", imu.TYPE)
    TF = ("tf", tf_message.TYPE)
    TF_STATIC = ("tf_static", tf_message.TYPE)
    OWN_POSE = ("own_pose", pose_message.TYPE)

    @property
    def ros_type(self) -> str:
        """Type as ``package/msg/Name``."""
        return self.value[1]


class Output(Enum):
    """Messages that a robot's gateway publishes, with their ROS types."""

    INITIAL_POSE = ("initialpose", pose_message.TYPE)
    POSE = ("pose", pose_message.TYPE)
    TF = ("tf", tf_message.TYPE)
    STATUS = ("status", diagnostic_array.TYPE)
    HYPOTHESES = ("hypotheses", pose_array.TYPE)

    @property
    def ros_type(self) -> str:
        """Type as ``package/msg/Name``."""
        return self.value[1]


Publish = Callable[[Output, bytes], None]  # takes CDR messages
Subscribers = Callable[[Output], "int | None"]  # of an output now; None: not known


@dataclass(frozen=True)
class Topics:
    """Topics of a robot. Those without a leading slash are relative to its namespace.

    Attributes:
        points: clouds. A namespace with a publisher of this topic is a robot.
        pose: pose for the robot's own localization to start from; published only when a fix is wanted.
        imu: gives gravity while the robot is at rest; None: gravity is not given.
        tf: the moving frames, of which odometry is one.
        tf_static: the fixed frames.
        own_pose: poses of the robot's own localization, if it does not publish them as a transform.
    """

    points: str = "points"
    pose: str = "initialpose"
    imu: str | None = None
    tf: str = "tf"
    tf_static: str = "tf_static"
    own_pose: str | None = None

    def input(self, kind: Input, namespace: str) -> str | None:
        """The full name of an input's topic; None if it is not used."""
        names = {
            Input.CLOUD: self.points,
            Input.IMU: self.imu,
            Input.TF: self.tf,
            Input.TF_STATIC: self.tf_static,
            Input.OWN_POSE: self.own_pose,
        }
        name = names[kind]
        return None if name is None else full_name(namespace, name)

    def output(self, kind: Output, namespace: str) -> str:
        """The full name of an output's topic."""
        if kind is Output.INITIAL_POSE:
            return full_name(namespace, self.pose)
        if kind is Output.TF:
            return full_name(namespace, self.tf)
        return full_name(namespace, f"{NODE_NAME}/{kind.value[0]}")

    def namespace_of(self, cloud_topic: str) -> str | None:
        """The namespace of the robot that publishes a topic; None if it has another name."""
        suffix = "/" + self.points.strip("/")
        return cloud_topic.removesuffix(suffix) if cloud_topic.endswith(suffix) else None


def full_name(namespace: str, topic: str) -> str:
    """The full name of a topic in a robot's namespace."""
    return topic if topic.startswith("/") else f"{namespace}/{topic}"

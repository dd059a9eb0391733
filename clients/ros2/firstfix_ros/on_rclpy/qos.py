"""Quality of service of a gateway's subscriptions and publishers."""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from ..robot.topics import Input

_DEPTHS = {Input.CLOUD: 1, Input.IMU: 100, Input.TF: 100, Input.OWN_POSE: 1}
_LATCHED_DEPTH = 1000  # of the last messages of all publishers of /tf_static together


def input_qos(kind: Input, *, reliable: bool = False) -> QoSProfile:
    """The quality of service of a subscription. Best effort hears every publisher.

    Args:
        reliable: what is lost is sent again; a best-effort publisher is not heard.
    """
    if kind is Input.TF_STATIC:
        return QoSProfile(depth=_LATCHED_DEPTH, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    reliability = ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT
    return QoSProfile(depth=_DEPTHS[kind], reliability=reliability)


def output_qos() -> QoSProfile:
    """The quality of service of a publisher: reliable and volatile, ROS 2's default."""
    return QoSProfile(depth=10)

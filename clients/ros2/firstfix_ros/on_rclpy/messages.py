"""Classes of the messages that a gateway takes and publishes. Their bodies pass as serialised bytes."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped
from sensor_msgs.msg import Imu
from tf2_msgs.msg import TFMessage

from ..robot.topics import Input, Output

INPUTS: dict[Input, Any] = {
    Input.IMU: Imu,
    Input.TF: TFMessage,
    Input.TF_STATIC: TFMessage,
    Input.OWN_POSE: PoseWithCovarianceStamped,
}


@cache
def cloud_class(ros_type: str) -> Any | None:
    """The class of a type of clouds; None: its package is not installed for this Python."""
    package, kind, name = ros_type.split("/")
    try:
        return getattr(import_module(f"{package}.{kind}"), name)
    except ImportError:
        return None


OUTPUTS: dict[Output, Any] = {
    Output.INITIAL_POSE: PoseWithCovarianceStamped,
    Output.POSE: PoseWithCovarianceStamped,
    Output.TF: TFMessage,
    Output.STATUS: DiagnosticArray,
    Output.HYPOTHESES: PoseArray,
}

"""Classes of the messages that a gateway takes and publishes. Their bodies pass as serialised bytes."""

from __future__ import annotations

from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped
from sensor_msgs.msg import Imu, PointCloud2
from tf2_msgs.msg import TFMessage

from ..robot.topics import Input, Output

INPUTS: dict[Input, Any] = {
    Input.CLOUD: PointCloud2,
    Input.IMU: Imu,
    Input.TF: TFMessage,
    Input.TF_STATIC: TFMessage,
    Input.OWN_POSE: PoseWithCovarianceStamped,
}
OUTPUTS: dict[Output, Any] = {
    Output.INITIAL_POSE: PoseWithCovarianceStamped,
    Output.POSE: PoseWithCovarianceStamped,
    Output.TF: TFMessage,
    Output.STATUS: DiagnosticArray,
    Output.HYPOTHESES: PoseArray,
}

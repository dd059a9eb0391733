"""ROS 2 node around ``firstfix_ros.robot``: topics, a service and parameters.

    in   points (sensor_msgs/PointCloud2), imu (sensor_msgs/Imu), tf, tf_static,
         own_pose (geometry_msgs/PoseWithCovarianceStamped)
    out  initialpose, ~/pose (geometry_msgs/PoseWithCovarianceStamped), tf,
         ~/hypotheses (geometry_msgs/PoseArray), ~/status (diagnostic_msgs/DiagnosticArray)
    srv  ~/relocalize (std_srvs/Trigger): search for a fix now

All messages pass as serialised bytes, so nothing is converted twice.
"""

from __future__ import annotations

import threading
from functools import partial
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped
from rclpy.executors import ExternalShutdownException
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import Imu, PointCloud2
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage

from firstfix.errors import FirstfixError

from .parameters import Parameters
from .robot.gateway import RobotGateway
from .robot.topics import NODE_NAME, RELOCALIZE, Input, Output

LOOK_S = 0.1
_OUTPUTS = {
    Output.INITIAL_POSE: (PoseWithCovarianceStamped, "initialpose"),
    Output.POSE: (PoseWithCovarianceStamped, "~/pose"),
    Output.TF: (TFMessage, "/tf"),
    Output.STATUS: (DiagnosticArray, "~/status"),
    Output.HYPOTHESES: (PoseArray, "~/hypotheses"),
}


class FirstFixNode(Node):  # type: ignore[misc]
    """Node of one robot: searches for a fix at start, and whenever its service is called, and watches.

    Raises:
        FirstfixError, ConnectionError: a parameter cannot be used, or nothing listens at ``zenoh``.
    """

    def __init__(self) -> None:
        super().__init__(NODE_NAME)
        defaults = Parameters.defaults()
        for name, value in defaults.items():
            self.declare_parameter(name, value)
        parameters = Parameters.checked({name: self.get_parameter(name).value for name in defaults})
        self._publishers = {
            output: self.create_publisher(kind, topic, 10) for output, (kind, topic) in _OUTPUTS.items()
        }
        self._client = parameters.client()
        self._gateway = RobotGateway(
            parameters.answerer(self._client),
            self._publish,
            parameters.config(),
            subscribers=lambda output: self._publishers[output].get_subscription_count(),
            log_line=self.get_logger().info,
            name=self.get_namespace(),
        )
        latched = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._hear(Input.TF_STATIC, TFMessage, "/tf_static", latched)
        self._hear(Input.TF, TFMessage, "/tf", 100)
        if parameters.imu:
            self._hear(Input.IMU, Imu, "imu", qos_profile_sensor_data)
        if parameters.own_pose:
            self._hear(Input.OWN_POSE, PoseWithCovarianceStamped, "own_pose", 1)
        self._hear(Input.CLOUD, PointCloud2, "points", qos_profile_sensor_data)
        self.create_service(Trigger, RELOCALIZE.replace(NODE_NAME, "~"), self._on_relocalize)
        self.create_timer(LOOK_S, self._gateway.tick)
        self._thread = threading.Thread(target=self._gateway.run, name="first fix", daemon=True)
        self._thread.start()

    def destroy_node(self) -> None:
        """Waits for the current query, closes the client, then destroys the node."""
        self._gateway.close()
        self._thread.join()
        self._client.close()
        super().destroy_node()

    def _hear(self, kind: Input, message: Any, topic: str, qos: Any) -> None:
        self.create_subscription(message, topic, partial(self._gateway.take, kind), qos, raw=True)

    def _publish(self, output: Output, body: bytes) -> None:
        self._publishers[output].publish(body)

    def _on_relocalize(self, request: Any, response: Any) -> Any:
        response.success, response.message = True, self._gateway.relocalize()
        return response


def main() -> None:
    """Runs the node until it is interrupted."""
    rclpy.init()
    try:
        node = FirstFixNode()
    except (FirstfixError, ConnectionError) as error:
        get_logger(NODE_NAME).fatal(str(error))
        raise SystemExit(2) from None
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()

"""ROS 2 node around ``firstfix_client.first_fix``: topics, a service and parameters.

    in   points (sensor_msgs/PointCloud2), imu (sensor_msgs/Imu), tf
    out  initialpose (geometry_msgs/PoseWithCovarianceStamped), /diagnostics
    srv  ~/locate (std_srvs/Trigger): search for a fix now

Clouds, IMU samples and the pose pass as serialised bytes, so nothing is converted twice.
"""

from __future__ import annotations

from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.executors import ExternalShutdownException
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from rclpy.time import Time
from sensor_msgs.msg import Imu, PointCloud2
from std_srvs.srv import Trigger
from tf2_ros import Buffer, TransformException, TransformListener

from firstfix.answer.localization import Localization
from firstfix.errors import FirstfixError, InputError
from firstfix.transform import Matrix, from_quaternion
from firstfix_client.first_fix import FirstFix

from .diagnosis import diagnosis_of
from .parameters import Parameters

DIAGNOSTICS_PERIOD_S = 1.0


class FirstFixNode(Node):  # type: ignore[misc]
    """Node that searches for a first fix at start, and whenever its service is called.

    Raises:
        FirstfixError, ConnectionError: a parameter cannot be used, or nothing listens at ``zenoh``.
    """

    def __init__(self) -> None:
        super().__init__("first_fix")
        defaults = Parameters.defaults()
        for name, value in defaults.items():
            self.declare_parameter(name, value)
        parameters = Parameters.checked({name: self.get_parameter(name).value for name in defaults})
        self._poses = self.create_publisher(PoseWithCovarianceStamped, "initialpose", 10)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._frames = Buffer()
        self._listener = TransformListener(self._frames, self)
        self._client = parameters.client()
        self._fix = FirstFix(
            parameters.ask(self._client), self._publish, parameters.config(), lookup=self._lookup
        )
        sensor = qos_profile_sensor_data
        self.create_subscription(PointCloud2, "points", self._fix.on_cloud, sensor, raw=True)
        if parameters.imu:
            self.create_subscription(Imu, "imu", self._on_imu, sensor, raw=True)
        self.create_service(Trigger, "~/locate", self._on_locate)
        self.create_timer(DIAGNOSTICS_PERIOD_S, self._tell)
        if parameters.at_start:
            self._fix.want()

    def destroy_node(self) -> None:
        """Ends the search, closes the client, then destroys the node."""
        self._fix.close()
        self._client.close()
        super().destroy_node()

    def _on_imu(self, body: bytes) -> None:
        try:
            self._fix.on_imu(body)
        except InputError as error:
            self.get_logger().warning(str(error), throttle_duration_sec=10.0)

    def _on_locate(self, request: Any, response: Any) -> Any:
        self._fix.want()
        response.success, response.message = (
            True,
            "searching for a fix; its pose is published when it is found",
        )
        return response

    def _publish(self, pose: bytes, answer: Localization) -> None:
        self._poses.publish(pose)
        self.get_logger().info(f"localized in {answer.map_id}, probability {answer.probability:.3f}")

    def _lookup(self, target: str, source: str) -> Matrix | None:
        try:
            found = self._frames.lookup_transform(target, source, Time()).transform
        except TransformException:
            return None
        t, q = found.translation, found.rotation
        return from_quaternion([t.x, t.y, t.z], [q.x, q.y, q.z, q.w])

    def _tell(self) -> None:
        diagnosis = diagnosis_of(self._fix.status)
        status = DiagnosticStatus(
            level=bytes([diagnosis.level]),
            name="first_fix",
            message=diagnosis.message,
            values=[KeyValue(key=key, value=value) for key, value in diagnosis.values.items()],
        )
        array = DiagnosticArray(status=[status])
        array.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(array)


def main() -> None:
    """Runs the node until it is interrupted."""
    rclpy.init()
    try:
        node = FirstFixNode()
    except (FirstfixError, ConnectionError) as error:
        get_logger("first_fix").fatal(str(error))
        raise SystemExit(2) from None
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()

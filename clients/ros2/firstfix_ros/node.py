"""ROS 2 node of one robot around ``firstfix_ros.robot``: topics, a service and parameters.

in   points (sensor_msgs/PointCloud2), imu (sensor_msgs/Imu), tf, tf_static,
     own_pose (geometry_msgs/PoseWithCovarianceStamped)
out  initialpose, ~/pose (geometry_msgs/PoseWithCovarianceStamped), tf,
     ~/hypotheses (geometry_msgs/PoseArray), ~/status (diagnostic_msgs/DiagnosticArray)
srv  ~/relocalize (std_srvs/Trigger): search for a fix now
"""

from __future__ import annotations

import signal
import sys
import threading
from contextlib import ExitStack
from dataclasses import asdict
from typing import Any

import rclpy
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.executors import SingleThreadedExecutor
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from firstfix.errors import FirstfixError, InvalidOption

from .on_rclpy.declared import declare
from .on_rclpy.robot import LOOK_S, Names, RclpyRobot
from .parameters import Parameters
from .robot.topics import NODE_NAME, REINITIALIZE, RELOCALIZE, Input, Output

_OUTPUTS = {
    Output.INITIAL_POSE: "initialpose",
    Output.POSE: "~/pose",
    Output.TF: "/tf",
    Output.STATUS: "~/status",
    Output.HYPOTHESES: "~/hypotheses",
}


class FirstFixNode(Node):  # type: ignore[misc]
    """Node of one robot: searches for a fix at start, and whenever its service is called, and watches.

    Raises:
        FirstfixError, ConnectionError: a parameter cannot be used, or nothing listens at ``zenoh``.
        ModuleNotFoundError: ``zenoh`` is set or the localizer is local, and its package is not installed.
    """

    def __init__(self) -> None:
        self._endings = ExitStack()  # of what was begun: a context that ends also destroys a node half made
        super().__init__(NODE_NAME)
        self._given = declare(self)
        answerer = self._given.answerer(self._endings, self.get_namespace())
        self._robot = RclpyRobot(
            self,
            _names(self._given),
            answerer,
            self._given.config(),
            hardware_id=self.get_namespace(),
            log_line=self.get_logger().info,
            overridable=True,
        )
        self._endings.callback(self._robot.join)
        self._endings.callback(self._robot.close)
        self.add_on_set_parameters_callback(self._on_set_parameters)
        # Not the node's clock: a simulation that stands still must not silence the status.
        self.create_timer(LOOK_S, self._robot.look, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def destroy_node(self) -> None:
        """Wait for the current query, close the client, then destroy the node."""
        self._endings.close()
        super().destroy_node()

    def _on_set_parameters(self, changes: list[Any]) -> SetParametersResult:
        own = asdict(self._given)
        try:
            given = Parameters.checked(own | {one.name: one.value for one in changes if one.name in own})
        except InvalidOption as error:
            return SetParametersResult(successful=False, reason=str(error))
        self._given = given
        self._robot.gateway.set_times(given.retry_s, given.watch_s)
        return SetParametersResult(successful=True)


def _names(given: Parameters) -> Names:
    inputs = {Input.CLOUD: "points", Input.TF: "/tf", Input.TF_STATIC: "/tf_static"}
    if given.imu:
        inputs[Input.IMU] = "imu"
    if given.own_pose:
        inputs[Input.OWN_POSE] = "own_pose"
    relocalize, reinitialize = (name.replace(NODE_NAME, "~") for name in (RELOCALIZE, REINITIALIZE))
    return Names(inputs, _OUTPUTS, relocalize, reinitialize)


def main() -> None:
    """Run the node until SIGINT or SIGTERM. It exits with 0, or with 2 if it cannot start."""
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    try:
        # rclpy's own handlers take the context away at once, while the node still needs it to end well.
        rclpy.init(args=sys.argv, signal_handler_options=SignalHandlerOptions.NO)
        node = FirstFixNode()
    except (FirstfixError, ConnectionError, ModuleNotFoundError, RuntimeError) as error:  # rclpy's own too
        get_logger(NODE_NAME).fatal(str(error))
        rclpy.try_shutdown()
        raise SystemExit(2) from None
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        while not stop.is_set():
            executor.spin_once(timeout_sec=LOOK_S)
    finally:
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()

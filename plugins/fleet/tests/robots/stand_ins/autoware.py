"""Autoware: an adaptor makes ``/initialpose`` a call of a service, which aligns the scan from this guess.

Read in autowarefoundation/autoware_universe, ``system/autoware_default_adapi_helpers``
(``initial_pose_adaptor.cpp``: a subscription with ``rclcpp::QoS(1)``, the pose's covariance is replaced,
``async_send_request``) and ``localization/autoware_pose_initializer/src/pose_initializer_core.cpp``
(``on_initialize``). The alignment itself answers ``success`` and, apart from it, ``reliable``: a pose that is
not reliable still initializes, and is told in the diagnostics. Not stood in for: the relay of the AD API
between the two, the fit of the height, and the alignment.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from autoware_localization_msgs.srv import InitializeLocalization
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.node import Node
from rclpy.qos import QoSProfile
from tf2_msgs.msg import TFMessage

from firstfix.transform import Matrix
from plugins.fleet.tests.robots.stand_ins.robot import LOOK_S, Robot, pose_of

INITIALIZE = "/localization/initialize"
Align = Callable[[Matrix], tuple[bool, bool]]  # of a guess: success, and reliable


class InitialPoseAdaptor(Node):
    """``autoware_initial_pose_adaptor``."""

    def __init__(self, robot: Robot) -> None:
        super().__init__("initial_pose_adaptor", context=robot.context)
        self.answers: list[Any] = []
        self._client = self.create_client(InitializeLocalization, INITIALIZE)
        self.create_subscription(
            PoseWithCovarianceStamped, "/initialpose", self._on_pose, QoSProfile(depth=1)
        )

    def _on_pose(self, message: Any) -> None:
        message.pose.covariance = [1.0 if n % 7 == 0 else 0.0 for n in range(36)]
        request = InitializeLocalization.Request(
            pose_with_covariance=[message], method=InitializeLocalization.Request.AUTO
        )
        future = self._client.call_async(request)
        future.add_done_callback(lambda done: self.answers.append(done.result().status))


class PoseInitializer(Node):
    """``pose_initializer``, with what follows it: once initialized, map -> base_link is in /tf."""

    def __init__(self, robot: Robot, align: Align) -> None:
        super().__init__("pose_initializer", context=robot.context)
        self.guesses: list[Matrix] = []
        self.is_reliable: bool | None = None
        self._robot, self._align = robot, align
        self._T_map_base: Matrix | None = None
        self._moving = self.create_publisher(TFMessage, "/tf", 100)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self.create_service(InitializeLocalization, INITIALIZE, self._on_initialize)
        self.create_timer(LOOK_S, self._look)

    @property
    def is_initialized(self) -> bool:
        return self._T_map_base is not None

    def _on_initialize(self, request: Any, response: Any) -> Any:
        guess = pose_of(request.pose_with_covariance[0])
        self.guesses.append(guess)
        self._T_map_base = None
        success, reliable = self._align(guess)
        response.status.success = success
        if not success:
            response.status.code = InitializeLocalization.Response.ERROR_ESTIMATION
            response.status.message = "align server failed."
            return response
        level = DiagnosticStatus.OK if reliable else DiagnosticStatus.ERROR
        told = DiagnosticStatus(level=level, name="pose_initializer_status")
        self._diagnostics.publish(DiagnosticArray(status=[told]))
        self.is_reliable, self._T_map_base = reliable, guess
        return response

    def _look(self) -> None:
        if self._T_map_base is not None:
            sent = self._robot.transform("map", "base_link", self._T_map_base)
            self._moving.publish(TFMessage(transforms=[sent]))

"""One robot on rclpy: carries the messages between its topics and its gateway."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

from rclpy.node import Node
from rclpy.qos_overriding_options import QoSOverridingOptions, QoSPolicyKind
from std_srvs.srv import Empty, Trigger

from ..robot.answerer import Answerer
from ..robot.cloud_types import missing_messages
from ..robot.config import GatewayConfig
from ..robot.gateway import RobotGateway
from ..robot.topics import Input, Output
from .messages import INPUTS, OUTPUTS, cloud_class
from .publishers import Publishers
from .qos import input_qos, output_qos

LOOK_S = 0.1  # between two calls of ``look``
_Way = tuple[bool, str]  # whether it is reliable, and the type of the messages
_OVERRIDABLE = (
    QoSPolicyKind.HISTORY,
    QoSPolicyKind.DEPTH,
    QoSPolicyKind.RELIABILITY,
    QoSPolicyKind.DURABILITY,
)


@dataclass(frozen=True)
class Names:
    """Names of a robot's topics and service, as a node resolves them.

    Attributes:
        inputs: those that are not named are not used.
        relocalize: service of type Trigger.
        reinitialize: the same of type Empty, as Nav2's behaviour trees call it.
    """

    inputs: Mapping[Input, str]
    outputs: Mapping[Output, str]
    relocalize: str
    reinitialize: str


class RclpyRobot:
    """One robot: subscribes to what its gateway needs now, publishes, and answers the service.

    Args:
        node: has subscriptions, publishers and service. The thread of its executor calls all methods.
        hardware_id: of the robot in its diagnostics: its namespace.
        overridable: the node's parameters ``qos_overrides`` may change the quality of service. Otherwise
            clouds are heard reliably where all their publishers are reliable.
    """

    def __init__(
        self,
        node: Node,
        names: Names,
        ask: Answerer,
        config: GatewayConfig,
        *,
        hardware_id: str,
        log_line: Callable[[str], None],
        overridable: bool = False,
    ) -> None:
        self._node, self._names, self._overridable = node, names, overridable
        self._clouds = Publishers(node, names.inputs[Input.CLOUD])
        self._overriding = QoSOverridingOptions(_OVERRIDABLE if overridable else ())
        self._subscriptions: dict[Input, tuple[_Way, Any]] = {}
        self._publishers = {
            output: node.create_publisher(
                kind, names.outputs[output], output_qos(), qos_overriding_options=self._overriding
            )
            for output, kind in OUTPUTS.items()
        }
        self.gateway = RobotGateway(
            ask,
            self._publish,
            config,
            subscribers=self.subscribers,
            log_line=log_line,
            name=hardware_id,
            wall_ns=lambda: node.get_clock().now().nanoseconds,
        )
        self._services = [
            node.create_service(Trigger, names.relocalize, self._on_relocalize),
            node.create_service(Empty, names.reinitialize, self._on_reinitialize),
        ]
        self._thread = threading.Thread(target=self.gateway.run, name=f"asks for {hardware_id}", daemon=True)
        self._thread.start()

    def look(self) -> None:
        """Subscribe to the topics that are of use now, and publish what is periodic."""
        self._clouds.look()
        needs = self.gateway.needs
        if self._clouds.rivals:  # a cloud of one robot would move the other one, too
            self.gateway.tell(self._clouds.rivals)
            needs -= {Input.CLOUD}
        elif cloud_class(self._clouds.cloud_type) is None:
            self.gateway.tell(missing_messages(self._clouds.cloud_type))
            needs -= {Input.CLOUD}
        for kind in reversed(tuple(Input)):  # the frames before the clouds, which they connect
            wanted = self._way(kind) if kind in needs and kind in self._names.inputs else None
            have = self._subscriptions.get(kind)
            if have is not None and have[0] != wanted:
                self._node.destroy_subscription(self._subscriptions.pop(kind)[1])
            if wanted is not None and kind not in self._subscriptions:
                self._subscriptions[kind] = wanted, self._subscribe(kind, *wanted)
        self.gateway.tick()

    def subscribers(self, output: Output) -> int:
        """How many subscriptions hear an output."""
        count: int = self._publishers[output].get_subscription_count()
        return count

    def close(self) -> None:
        """Remove the robot's endpoints, and end the search after the current query."""
        self.gateway.close()
        for _, subscription in self._subscriptions.values():
            self._node.destroy_subscription(subscription)
        self._subscriptions.clear()
        for service in self._services:
            self._node.destroy_service(service)

    @property
    def is_asking(self) -> bool:
        """True until ``join`` need not wait."""
        return self._thread.is_alive()

    def join(self) -> None:
        """Wait for the current query, and remove the publishers."""
        self._thread.join()
        for publisher in self._publishers.values():
            self._node.destroy_publisher(publisher)

    def _way(self, kind: Input) -> _Way:
        """The way in which an input is to be subscribed to now: whether reliably, and by which type."""
        if kind is not Input.CLOUD:
            return False, kind.ros_type
        return self._clouds.are_reliable and not self._overridable, self._clouds.cloud_type

    def _subscribe(self, kind: Input, reliable: bool, ros_type: str) -> Any:
        return self._node.create_subscription(
            cloud_class(ros_type) if kind is Input.CLOUD else INPUTS[kind],
            self._names.inputs[kind],
            partial(self.gateway.take, kind, cloud_type=ros_type),
            input_qos(kind, reliable=reliable),
            qos_overriding_options=self._overriding,
            raw=True,
        )

    def _publish(self, output: Output, body: bytes) -> None:
        self._publishers[output].publish(body)

    def _on_relocalize(self, request: Any, response: Any) -> Any:
        response.success, response.message = True, self.gateway.relocalize()
        return response

    def _on_reinitialize(self, request: Any, response: Any) -> Any:
        self.gateway.relocalize()
        return response

"""The gateway of a fleet of robots by rclpy: any distribution from Humble on, any middleware.

A robot is a namespace with a publisher of clouds.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from firstfix.errors import InvalidOption

from ..robot.answerer import Answerer, of_robot
from ..robot.cloud_types import CLOUD_TYPES
from ..robot.config import GatewayConfig
from ..robot.topics import REINITIALIZE, RELOCALIZE, Input, Output, Topics, full_name
from .robot import LOOK_S, Names, RclpyRobot

NODE_NAME = "firstfix_gateway"
MAX_ROBOTS = 1000
_FOLLOW_S = 0.5  # between two looks at the ROS graph


class RclpyFleet:
    """Follows robots as they appear and disappear, in one thread.

    Args:
        ask: who answers; each robot's thread calls it.
        domain: ROS_DOMAIN_ID.

    Raises:
        InvalidOption: the middleware does not allow it.
    """

    def __init__(
        self,
        ask: Answerer,
        config: GatewayConfig,
        *,
        domain: int = 0,
        topics: Topics | None = None,
        log_line: Callable[[str, str], None] = lambda namespace, line: None,
    ) -> None:
        self.robots: dict[str, RclpyRobot] = {}
        self._ask, self._config, self._log_line = ask, config, log_line
        self._topics = topics or Topics()
        self._leaving: list[RclpyRobot] = []  # those that are gone, until their query ends
        self._refused: set[str] = set()
        self._context = rclpy.Context()
        try:
            self._context.init([], domain_id=domain)
            self._node = Node(
                NODE_NAME, context=self._context, enable_rosout=False, start_parameter_services=False
            )
        except RuntimeError as error:  # also rclpy's RCLError
            raise InvalidOption(f"cannot join the ROS domain {domain}: {error}") from None
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)

    def run(self, stop: threading.Event) -> None:
        """Block until ``stop`` is set, then remove all robots and the node."""
        look_s = follow_s = time.monotonic()
        try:
            while not stop.is_set():
                self._executor.spin_once(timeout_sec=LOOK_S)
                now_s = time.monotonic()
                if now_s >= follow_s:
                    follow_s = now_s + _FOLLOW_S
                    self._follow()
                if now_s >= look_s:
                    look_s = now_s + LOOK_S
                    for robot in self.robots.values():
                        robot.look()
        finally:
            for robot in self.robots.values():
                robot.close()
            for robot in (*self.robots.values(), *self._leaving):
                robot.join()
            self.robots.clear()
            self._executor.shutdown()
            self._node.destroy_node()
            self._context.try_shutdown()

    def _follow(self) -> None:
        """Compare the robots with the publishers of clouds in the ROS graph."""
        found = self._namespaces()
        for namespace in self.robots.keys() - found:
            robot = self.robots.pop(namespace)
            robot.close()
            self._leaving.append(robot)
            self._log_line(namespace, "gone")
        for robot in [one for one in self._leaving if not one.is_asking]:
            robot.join()
            self._leaving.remove(robot)
        for namespace in found:
            if namespace not in self.robots and self._is_room_for(namespace):
                self.robots[namespace] = self._robot(namespace)

    def _namespaces(self) -> set[str]:
        """The namespaces of the robots: of those with a publisher of clouds."""
        found = set()
        for topic, types in self._node.get_topic_names_and_types():
            namespace = self._topics.namespace_of(topic)
            is_cloud = not set(CLOUD_TYPES).isdisjoint(types)
            if namespace is not None and is_cloud and self._node.count_publishers(topic):
                found.add(namespace)
        return found

    def _is_room_for(self, namespace: str) -> bool:
        if len(self.robots) < MAX_ROBOTS:
            return True
        if namespace not in self._refused:
            self._refused.add(namespace)
            self._log_line(namespace, f"more than {MAX_ROBOTS} robots: this one is not served")
        return False

    def _robot(self, namespace: str) -> RclpyRobot:
        def log_line(line: str) -> None:
            self._log_line(namespace, line)

        return RclpyRobot(
            self._node,
            _names(self._topics, namespace),
            of_robot(self._ask, namespace),
            self._config,
            hardware_id=namespace or "/",
            log_line=log_line,
        )


def _names(topics: Topics, namespace: str) -> Names:
    inputs = {kind: name for kind in Input if (name := topics.input(kind, namespace)) is not None}
    outputs = {kind: topics.output(kind, namespace) for kind in Output}
    return Names(inputs, outputs, full_name(namespace, RELOCALIZE), full_name(namespace, REINITIALIZE))

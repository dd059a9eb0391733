"""The gateway of a fleet of robots on rmw_zenoh.

A robot is a namespace with a publisher of clouds, which the gateway finds by its liveliness token. It
subscribes to the robot's topics only while they are of use, so a robot with a fix costs no traffic.
"""

from __future__ import annotations

import json
import queue
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import zenoh

from firstfix.errors import InvalidOption
from firstfix.ros.rmw_zenoh import Endpoint, dds_type, parse_token, publishers_pattern
from firstfix.wire.endpoints import ENDPOINT_FORM, said_by_zenoh
from firstfix_client.errors import ServiceUnreachable
from firstfix_ros.robot.answerer import Answerer, of_robot
from firstfix_ros.robot.cloud_types import CLOUD_TYPES
from firstfix_ros.robot.config import GatewayConfig
from firstfix_ros.robot.topics import Topics

from .graph import Graph
from .robot import Robot

_TYPES = {dds_type(ros_type): ros_type for ros_type in CLOUD_TYPES}
_LOOK_S = 0.1  # poll interval of requests and tokens


class RosGateway:
    """Gateway of a fleet: follows robots as they appear and disappear.

    Args:
        session: zenoh session at the robots' router.
        ask: who answers; each robot's thread calls it.
    """

    def __init__(
        self,
        session: Any,
        ask: Answerer,
        config: GatewayConfig,
        *,
        domain: int = 0,
        topics: Topics | None = None,
        log_line: Callable[[str, str], None] = lambda namespace, line: None,
    ) -> None:
        self.robots: dict[str, Robot] = {}
        self._graph = Graph(session, domain)
        self._ask, self._config, self._log_line = ask, config, log_line
        self._topics = topics or Topics()
        self._tokens: queue.SimpleQueue[tuple[bool, str]] = queue.SimpleQueue()

    def run(self, stop: threading.Event) -> None:
        """Block until ``stop`` is set, then remove all endpoints."""
        liveliness = self._graph.session.liveliness()
        subscribers = [
            liveliness.declare_subscriber(
                publishers_pattern(self._graph.domain, ros_type), self._on_token, history=True
            )
            for ros_type in CLOUD_TYPES
        ]
        try:
            while not stop.is_set():
                with suppress(queue.Empty):
                    self._follow(*self._tokens.get(timeout=_LOOK_S))
                for robot in self.robots.values():
                    robot.look()
        finally:
            for subscriber in subscribers:
                subscriber.undeclare()
            for robot in self.robots.values():
                robot.close()
            for robot in self.robots.values():
                robot.join()
            self.robots.clear()
            self._graph.close()

    def _on_token(self, sample: Any) -> None:
        self._tokens.put((sample.kind != zenoh.SampleKind.DELETE, str(sample.key_expr)))

    def _follow(self, came: bool, token: str) -> None:
        clouds = parse_token(token)
        namespace = None if clouds is None else self._topics.namespace_of(clouds.topic)
        if clouds is None or namespace is None:
            return
        if came:
            served = self._robot(namespace, clouds)
            if served.clouds.dds_type == clouds.dds_type:
                served.publishers.add(token)
            else:
                self._log_line(
                    namespace, f"its clouds of {clouds.dds_type} are not taken: it has others, too"
                )
        elif (robot := self.robots.get(namespace)) is not None:
            robot.publishers.discard(token)
            if not robot.publishers:
                self.robots.pop(namespace).close()
                self._log_line(namespace, "gone")

    def _robot(self, namespace: str, clouds: Endpoint) -> Robot:
        if namespace not in self.robots:

            def log_line(line: str) -> None:
                self._log_line(namespace, line)

            self.robots[namespace] = Robot(
                self._graph,
                clouds,
                _TYPES[clouds.dds_type],
                namespace,
                self._topics,
                of_robot(self._ask, namespace),
                self._config,
                log_line,
            )
        return self.robots[namespace]


def open_session(endpoint_address: str) -> Any:
    """Open a session at the robots' router.

    Raises:
        InvalidOption: not a valid endpoint.
        ServiceUnreachable: nothing listens there.
    """
    config = zenoh.Config()
    try:
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", json.dumps([endpoint_address]))
        config.insert_json5("scouting/multicast/enabled", "false")
    except zenoh.ZError as error:
        raise InvalidOption(
            f"not a zenoh endpoint: {endpoint_address!r}: {said_by_zenoh(error)}; {ENDPOINT_FORM}"
        ) from None
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        raise ServiceUnreachable(f"no zenoh peer at {endpoint_address}: {said_by_zenoh(error)}") from None

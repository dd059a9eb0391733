"""The gateway of a fleet of robots on DDS. A robot is a namespace with a publisher of clouds."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

from firstfix.errors import FirstfixError
from firstfix.ros.rmw_zenoh import dds_type
from firstfix_ros.robot.answerer import Answerer, of_robot
from firstfix_ros.robot.cloud_types import CLOUD_TYPES
from firstfix_ros.robot.config import GatewayConfig
from firstfix_ros.robot.topics import Topics

from . import qos
from .participant import TOPIC, Participant
from .robot import Robot

MAX_ROBOTS = 1000
_LOOK_S = 0.1
_TYPES = {dds_type(ros_type): ros_type for ros_type in CLOUD_TYPES}


class DdsFleet:
    """Follows robots as they appear and disappear, in one thread.

    Args:
        ask: who answers; each robot's thread calls it.
    """

    def __init__(
        self,
        participant: Participant,
        ask: Answerer,
        config: GatewayConfig,
        *,
        topics: Topics | None = None,
        log_line: Callable[[str, str], None] = lambda namespace, line: None,
    ) -> None:
        self.robots: dict[str, Robot] = {}
        self._participant, self._ask, self._config, self._log_line = participant, ask, config, log_line
        self._topics = topics or Topics()
        self._namespaces: dict[Any, str] = {}  # by the key of a publisher

    def run(self, stop: threading.Event) -> None:
        """Block until ``stop`` is set, then remove all robots."""
        look_s = time.monotonic()
        try:
            while not stop.is_set():
                self._participant.wait(_LOOK_S)
                for publication in self._participant.publications():
                    self._follow(publication)
                if time.monotonic() >= look_s:
                    look_s = time.monotonic() + _LOOK_S
                    for namespace, robot in self.robots.items():
                        self._look(namespace, robot)
        finally:
            for robot in self.robots.values():
                robot.close()
            for robot in self.robots.values():
                robot.join()
            self.robots.clear()

    def _look(self, namespace: str, robot: Robot) -> None:
        try:
            robot.look()
        except (FirstfixError, ConnectionError) as error:  # of one robot: the others go on
            self._log_line(namespace, str(error))

    def _follow(self, publication: Any) -> None:
        key = publication.key
        if not publication.sample_info.valid_data:
            self._forget(key)
        elif publication.type_name in _TYPES and publication.topic_name.startswith(TOPIC + "/"):
            namespace = self._topics.namespace_of(publication.topic_name.removeprefix(TOPIC))
            if namespace is not None and self._is_room_for(namespace, _TYPES[publication.type_name]):
                self._namespaces[key] = namespace
                self.robots[namespace].publishers[key] = qos.is_reliable(publication.qos)

    def _is_room_for(self, namespace: str, cloud_type: str) -> bool:
        if namespace in self.robots:
            had = self.robots[namespace].cloud_type
            if had != cloud_type:
                self._log_line(namespace, f"its clouds are {had}, and those of {cloud_type} are not taken")
            return had == cloud_type
        if len(self.robots) >= MAX_ROBOTS:
            self._log_line(namespace, f"more than {MAX_ROBOTS} robots: this one is not served")
            return False

        def log_line(line: str) -> None:
            self._log_line(namespace, line)

        try:
            self.robots[namespace] = Robot(
                self._participant,
                namespace,
                cloud_type,
                self._topics,
                of_robot(self._ask, namespace),
                self._config,
                log_line,
            )
        except ConnectionError as error:  # strange names of one robot: the others go on
            log_line(str(error))
            return False
        return True

    def _forget(self, key: Any) -> None:
        namespace = self._namespaces.pop(key, None)
        if namespace is None:
            return
        robot = self.robots[namespace]
        del robot.publishers[key]
        if not robot.publishers:
            self.robots.pop(namespace).close()
            self._log_line(namespace, "gone")

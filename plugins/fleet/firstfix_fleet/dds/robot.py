"""One robot on DDS: carries the messages between its topics and its gateway."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import partial
from typing import Any

from cyclonedds.core import Qos

from firstfix_ros.robot.answerer import Answerer
from firstfix_ros.robot.config import GatewayConfig
from firstfix_ros.robot.gateway import RobotGateway
from firstfix_ros.robot.topics import RELOCALIZE, Input, Output, Topics, full_name

from . import qos
from .participant import TOPIC, Participant
from .trigger_service import TriggerService

_DEPTHS = {Input.CLOUD: 1, Input.IMU: 100, Input.TF: 100, Input.OWN_POSE: 1}
_LATCHED_DEPTH = 1000  # of the last messages of all publishers of /tf_static together
_OUTPUT_DEPTH = 10


class Robot:
    """One robot. All methods are called by the fleet's thread.

    Attributes:
        publishers: of its clouds, by their key: whether they are reliable.
        cloud_type: of their messages.
    """

    def __init__(
        self,
        participant: Participant,
        namespace: str,
        cloud_type: str,
        topics: Topics,
        ask: Answerer,
        config: GatewayConfig,
        log_line: Callable[[str], None],
    ) -> None:
        self.publishers: dict[Any, bool] = {}
        self.cloud_type = cloud_type
        self._participant, self._namespace, self._topics, self._log_line = (
            participant,
            namespace,
            topics,
            log_line,
        )
        self._readers: dict[Input, tuple[bool, Any]] = {}
        self._writers = {
            kind: participant.writer(
                TOPIC + topics.output(kind, namespace), kind.ros_type, qos.reliable(_OUTPUT_DEPTH)
            )
            for kind in Output
        }
        self.gateway = RobotGateway(
            ask, self._publish, config, subscribers=self.subscribers, log_line=log_line, name=namespace or "/"
        )
        self._service = TriggerService(
            participant, full_name(namespace, RELOCALIZE), self.gateway.relocalize, log_line
        )
        self._thread = threading.Thread(target=self.gateway.run, name=f"asks for {namespace}", daemon=True)
        self._thread.start()

    def look(self) -> None:
        """Read the topics that are of use now, and publish what is periodic."""
        needs = self.gateway.needs
        for kind in Input:
            topic = self._topics.input(kind, self._namespace)
            wanted = self._is_reliable(kind) if kind in needs and topic is not None else None
            have = self._readers.get(kind)
            if have is not None and have[0] is not wanted:
                self._participant.stop_reading(self._readers.pop(kind)[1])
            if wanted is not None and kind not in self._readers:
                take = partial(self._take, kind)
                ros_type = self.cloud_type if kind is Input.CLOUD else kind.ros_type
                reader = self._participant.read(f"{TOPIC}{topic}", ros_type, self._qos(kind), take)
                self._readers[kind] = wanted, reader
        self._service.send_waiting()
        self.gateway.tick()

    def subscribers(self, output: Output) -> int:
        """How many subscriptions hear an output."""
        return len(self._writers[output].readers())

    def close(self) -> None:
        """Remove the robot's readers and its service, and end the search after the current query."""
        for _, reader in self._readers.values():
            self._participant.stop_reading(reader)
        self._readers.clear()
        self._service.close()
        self.gateway.close()

    def join(self) -> None:
        """Wait for the current query."""
        self._thread.join()

    def _is_reliable(self, kind: Input) -> bool:
        """Whether an input is read reliably: clouds if all their publishers offer it."""
        return kind is Input.TF_STATIC or (kind is Input.CLOUD and all(self.publishers.values()))

    def _qos(self, kind: Input) -> Qos:
        if kind is Input.TF_STATIC:
            return qos.latched(_LATCHED_DEPTH)
        return qos.reliable(1) if self._is_reliable(kind) else qos.sensor_data(_DEPTHS[kind])

    def _take(self, kind: Input, body: bytes, info: Any) -> None:
        self.gateway.take(kind, body, self.cloud_type)

    def _publish(self, kind: Output, body: bytes) -> None:
        self._writers[kind].write(body)

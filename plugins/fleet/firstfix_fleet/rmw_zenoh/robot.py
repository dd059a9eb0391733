"""One robot on rmw_zenoh: carries the messages between its topics and its gateway."""

from __future__ import annotations

import itertools
import os
import threading
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import zenoh

from firstfix.errors import FirstfixError
from firstfix.ros.cdr import CdrWriter
from firstfix.ros.rmw_zenoh import (
    PUBLISHER,
    RELIABLE_QOS,
    SERVICE,
    Attachment,
    Endpoint,
    endpoint,
)
from firstfix.ros.type_hashes import TRIGGER
from firstfix_ros.robot.answerer import Answerer
from firstfix_ros.robot.config import GatewayConfig
from firstfix_ros.robot.gateway import RobotGateway
from firstfix_ros.robot.topics import RELOCALIZE, Input, Output, Topics, full_name

from .graph import Graph
from .subscribers import Subscribers


class Robot:
    """One robot: subscribes to what its gateway needs now, publishes, and answers the service.

    Attributes:
        publishers: tokens of those of its clouds.
        clouds: the first of them.
    """

    def __init__(
        self,
        graph: Graph,
        clouds: Endpoint,
        cloud_type: str,
        namespace: str,
        topics: Topics,
        ask: Answerer,
        config: GatewayConfig,
        log_line: Callable[[str], None],
    ) -> None:
        self.publishers: set[str] = set()
        self._graph, self.clouds, self._namespace, self._topics = graph, clouds, namespace, topics
        self._cloud_type = cloud_type
        self._outputs = {
            kind: self._endpoint(PUBLISHER, topics.output(kind, namespace), kind.ros_type) for kind in Output
        }
        relocalize = self._endpoint(SERVICE, full_name(namespace, RELOCALIZE), TRIGGER)
        self._sequences = {kind: itertools.count(1) for kind in Output}
        self._gid = os.urandom(16)
        self._listening: dict[Input, list[Any]] = {}
        self._subscribers = {
            kind: Subscribers(graph.session, output) for kind, output in self._outputs.items()
        }
        self.gateway = RobotGateway(
            ask, self._publish, config, subscribers=self.subscribers, log_line=log_line, name=namespace or "/"
        )
        self._declared = [
            *(graph.token(output, RELIABLE_QOS) for output in self._outputs.values()),
            graph.session.declare_queryable(relocalize.key, self._on_relocalize, complete=True),
            graph.token(relocalize, RELIABLE_QOS),
        ]
        self._thread = threading.Thread(target=self.gateway.run, name=f"asks for {namespace}", daemon=True)
        self._thread.start()

    def look(self) -> None:
        """Subscribe to the topics that are of use now, and publish what is periodic."""
        needs = self.gateway.needs
        for kind in reversed(tuple(Input)):  # the frames before the clouds, which they connect
            topic = self._topics.input(kind, self._namespace)
            if kind in needs and topic is not None and kind not in self._listening:
                self._listening[kind] = self._graph.subscribe(
                    self._publisher_of(kind, topic),
                    partial(self.gateway.take, kind, cloud_type=self._cloud_type),
                    latched=kind is Input.TF_STATIC,
                )
            elif kind not in needs:
                self._rest(kind)
        self.gateway.tick()

    def subscribers(self, output: Output) -> int:
        """How many subscriptions hear an output."""
        return self._subscribers[output].count()

    def close(self) -> None:
        """Remove the robot's endpoints, and end the search after the current query."""
        for kind in Input:
            self._rest(kind)
        for subscribers in self._subscribers.values():
            subscribers.close()
        for declared in self._declared:
            declared.undeclare()
        self.gateway.close()

    def join(self) -> None:
        """Wait for the current query."""
        self._thread.join()

    def _endpoint(self, kind: str, topic: str, ros_type: str) -> Endpoint:
        return endpoint(self._graph.domain, kind, topic, ros_type, humble=self.clouds.is_humble)

    def _publisher_of(self, kind: Input, topic: str) -> Endpoint:
        return self.clouds if kind is Input.CLOUD else self._endpoint(PUBLISHER, topic, kind.ros_type)

    def _rest(self, kind: Input) -> None:
        for declared in self._listening.pop(kind, []):
            declared.undeclare()

    def _publish(self, kind: Output, body: bytes) -> None:
        attachment = Attachment(next(self._sequences[kind]), time.time_ns(), self._gid)
        self._graph.session.put(
            self._outputs[kind].key,
            body,
            attachment=attachment.to_bytes(),
            congestion_control=zenoh.CongestionControl.BLOCK,  # a pose must not be dropped
        )

    def _on_relocalize(self, query: Any) -> None:
        with query:
            raw = query.attachment
            try:
                asked = Attachment.from_bytes(b"" if raw is None else raw.to_bytes())
            except FirstfixError:
                return  # not a ROS 2 service call
            writer = CdrWriter()
            writer.numbers("B", [True])
            writer.text(self.gateway.relocalize())
            attachment = Attachment(asked.sequence, time.time_ns(), asked.gid)
            query.reply(query.key_expr, writer.bytes(), attachment=attachment.to_bytes())

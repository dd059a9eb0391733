"""Gateway for robots on rmw_zenoh: finds the first fix of every robot of a fleet.

A robot is a namespace with a publisher of clouds, which the gateway finds by its liveliness token. It
subscribes to the clouds only while a fix is wanted, so a robot with a fix costs no traffic.
"""

from __future__ import annotations

import itertools
import json
import os
import queue
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Any

import zenoh

from firstfix.answer.localization import Localization
from firstfix.errors import FirstfixError, InvalidOption
from firstfix.ros import point_cloud2, pose_message
from firstfix.ros.cdr import CdrWriter
from firstfix.ros.rmw_zenoh import (
    PUBLISHER,
    RELIABLE_QOS,
    SENSOR_QOS,
    SERVICE,
    SUBSCRIPTION,
    TRIGGER,
    Attachment,
    Endpoint,
    Node,
    endpoint,
    parse_token,
    publishers_pattern,
)
from firstfix_client.errors import ServiceUnreachable
from firstfix_client.first_fix import Ask, FirstFix, FirstFixConfig, State

NODE_NAME = "firstfix_gateway"
LOCATE = "first_fix/locate"
_LOOK_S = 0.1  # poll interval of requests and tokens
Tell = Callable[[str, str], None]  # a robot's namespace and a line about it


class Graph:
    """The gateway's node in the ROS graph: declares endpoints with their tokens."""

    def __init__(self, session: Any, domain: int) -> None:
        self.session = session
        self.domain = domain
        self._node = Node(domain, str(session.info.zid()), NODE_NAME)
        self._numbers = itertools.count(1)
        self._node_token = session.liveliness().declare_token(self._node.token)

    def close(self) -> None:
        """Removes the node from the graph."""
        self._node_token.undeclare()

    def token(self, of: Endpoint, qos: str) -> Any:
        """Declares the token of an endpoint."""
        return self.session.liveliness().declare_token(
            self._node.endpoint_token(next(self._numbers), of, qos)
        )


class Robot:
    """One robot: takes its clouds while a fix is wanted, publishes the pose, and answers the service."""

    def __init__(
        self,
        graph: Graph,
        clouds: Endpoint,
        namespace: str,
        pose_topic: str,
        ask: Ask,
        config: FirstFixConfig,
        tell: Tell,
    ) -> None:
        self.publishers: set[str] = set()  # their tokens
        self._graph, self._clouds, self._namespace, self._tell = graph, clouds, namespace, tell
        self._pose = endpoint(
            graph.domain, PUBLISHER, f"{namespace}/{pose_topic}", pose_message.TYPE, humble=clouds.is_humble
        )
        locate = endpoint(graph.domain, SERVICE, f"{namespace}/{LOCATE}", TRIGGER, humble=clouds.is_humble)
        self._sequence, self._gid = itertools.count(1), os.urandom(16)
        self._listening: tuple[Any, Any] | None = None
        self._reported: tuple[State, str] | None = None
        self.fix = FirstFix(ask, self._publish, config)
        self._declared = [
            graph.token(self._pose, RELIABLE_QOS),
            graph.session.declare_queryable(locate.key, self._on_locate, complete=True),
            graph.token(locate, RELIABLE_QOS),
        ]

    def look(self) -> None:
        """Subscribes to the clouds while a fix is wanted, and reports changes of the state."""
        wanted = self.fix.wanted
        if wanted and self._listening is None:
            of = replace(self._clouds, kind=SUBSCRIPTION)
            subscriber = self._graph.session.declare_subscriber(
                self._clouds.key, lambda sample: self.fix.on_cloud(sample.payload.to_bytes())
            )
            self._listening = subscriber, self._graph.token(of, SENSOR_QOS)
        elif not wanted:
            self._rest()
        status = self.fix.status
        if (status.state, status.error) != self._reported and status.state is not State.ASKING:
            self._reported = status.state, status.error
            self._tell(self._namespace, status.state.value + (f": {status.error}" if status.error else ""))

    def close(self) -> None:
        """Ends the search and removes the robot's endpoints."""
        self._rest()
        for declared in self._declared:
            declared.undeclare()
        self.fix.close()

    def _rest(self) -> None:
        if self._listening is not None:
            for declared in self._listening:
                declared.undeclare()
            self._listening = None

    def _publish(self, pose: bytes, answer: Localization) -> None:
        attachment = Attachment(next(self._sequence), time.time_ns(), self._gid)
        self._graph.session.put(
            self._pose.key,
            pose,
            attachment=attachment.to_bytes(),
            congestion_control=zenoh.CongestionControl.BLOCK,  # a pose must not be dropped
        )

    def _on_locate(self, query: Any) -> None:
        with query:
            raw = query.attachment
            try:
                asked = Attachment.from_bytes(b"" if raw is None else raw.to_bytes())
            except FirstfixError:
                return  # not a ROS 2 service call
            self.fix.want()
            writer = CdrWriter()
            writer.numbers("B", [True])
            writer.text("searching for a fix; its pose is published when it is found")
            attachment = Attachment(asked.sequence, time.time_ns(), asked.gid)
            query.reply(query.key_expr, writer.bytes(), attachment=attachment.to_bytes())


class RosGateway:
    """Gateway of a fleet: follows robots as they appear and disappear.

    Args:
        session: zenoh session at the robots' router.
        points, pose_topic: topics relative to a robot's namespace, without a leading slash.
        at_start: search for a fix when a robot appears.
    """

    def __init__(
        self,
        session: Any,
        ask: Ask,
        config: FirstFixConfig,
        *,
        domain: int = 0,
        points: str = "points",
        pose_topic: str = "initialpose",
        at_start: bool = True,
        tell: Tell = lambda namespace, line: None,
    ) -> None:
        self.robots: dict[str, Robot] = {}
        self._graph = Graph(session, domain)
        self._ask, self._config, self._tell = ask, config, tell
        self._suffix, self._pose_topic = "/" + points.strip("/"), pose_topic.strip("/")
        self._at_start = at_start
        self._tokens: queue.SimpleQueue[tuple[bool, str]] = queue.SimpleQueue()

    def run(self, stop: threading.Event) -> None:
        """Blocks until ``stop`` is set, then removes all endpoints."""
        subscriber = self._graph.session.liveliness().declare_subscriber(
            publishers_pattern(self._graph.domain, point_cloud2.TYPE), self._on_token, history=True
        )
        try:
            while not stop.is_set():
                with suppress(queue.Empty):
                    self._follow(*self._tokens.get(timeout=_LOOK_S))
                for robot in self.robots.values():
                    robot.look()
        finally:
            subscriber.undeclare()
            for robot in self.robots.values():
                robot.close()
            self.robots.clear()
            self._graph.close()

    def _on_token(self, sample: Any) -> None:
        self._tokens.put((sample.kind != zenoh.SampleKind.DELETE, str(sample.key_expr)))

    def _follow(self, came: bool, token: str) -> None:
        clouds = parse_token(token)
        if clouds is None or not clouds.topic.endswith(self._suffix):
            return
        namespace = clouds.topic.removesuffix(self._suffix)
        if came:
            self._robot(namespace, clouds).publishers.add(token)
        elif (robot := self.robots.get(namespace)) is not None:
            robot.publishers.discard(token)
            if not robot.publishers:
                self.robots.pop(namespace).close()
                self._tell(namespace, "gone")

    def _robot(self, namespace: str, clouds: Endpoint) -> Robot:
        if namespace not in self.robots:
            self.robots[namespace] = robot = Robot(
                self._graph, clouds, namespace, self._pose_topic, self._ask, self._config, self._tell
            )
            if self._at_start:
                robot.fix.want()
        return self.robots[namespace]


def open_session(endpoint_address: str) -> Any:
    """Opens a session at the robots' router.

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
        raise InvalidOption(f"not a zenoh endpoint: {endpoint_address!r}: {error}") from None
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        raise ServiceUnreachable(f"no zenoh peer at {endpoint_address}: {error}") from None

"""One robot of the gateway's fleet."""

from __future__ import annotations

import itertools
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import zenoh

from firstfix.answer.localization import Localization
from firstfix.errors import FirstfixError, InputError, NotFound
from firstfix.ros import imu, pose_message, static_transforms
from firstfix.ros.cdr import CdrWriter
from firstfix.ros.rmw_zenoh import (
    PUBLISHER,
    RELIABLE_QOS,
    SERVICE,
    TRIGGER,
    Attachment,
    Endpoint,
    endpoint,
)
from firstfix.ros.static_transforms import StaticTransforms, decode_transforms
from firstfix.transform import Matrix
from firstfix_client.first_fix import Ask, FirstFix, FirstFixConfig, State

from .graph import Graph

LOCATE = "first_fix/locate"
Tell = Callable[[str, str], None]  # a robot's namespace and a line about it


@dataclass(frozen=True)
class Topics:
    """Topics of a robot. Those without a leading slash are relative to its namespace.

    Attributes:
        imu: gives gravity while the robot is at rest; None: gravity is not given.
        tf_static: says how IMU, sensor and base are mounted. Heard only if the IMU or a base frame is used.
    """

    points: str = "points"
    pose: str = "initialpose"
    imu: str | None = None
    tf_static: str = "tf_static"


class Robot:
    """One robot: takes its clouds while a fix is wanted, publishes the pose, and answers the service."""

    def __init__(
        self,
        graph: Graph,
        clouds: Endpoint,
        namespace: str,
        topics: Topics,
        ask: Ask,
        config: FirstFixConfig,
        tell: Tell,
    ) -> None:
        self.publishers: set[str] = set()  # their tokens
        self._graph, self._clouds, self._namespace, self._tell = graph, clouds, namespace, tell
        self._topics, self._uses_frames = topics, bool(topics.imu or config.base_frame)
        self._pose = self._endpoint(PUBLISHER, topics.pose, pose_message.TYPE)
        locate = self._endpoint(SERVICE, LOCATE, TRIGGER)
        self._sequence, self._gid = itertools.count(1), os.urandom(16)
        self._listening: list[Any] = []
        self._reported: tuple[State, str] | None = None
        self._frames, self._bad_message = StaticTransforms(), ""
        self.fix = FirstFix(ask, self._publish, config, lookup=self._lookup)
        self._declared = [
            graph.token(self._pose, RELIABLE_QOS),
            graph.session.declare_queryable(locate.key, self._on_locate, complete=True),
            graph.token(locate, RELIABLE_QOS),
        ]

    def look(self) -> None:
        """Subscribes to the robot's topics while a fix is wanted, and reports changes of the state."""
        wanted = self.fix.wanted
        if wanted and not self._listening:
            self._listen()
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

    def _endpoint(self, kind: str, topic: str, ros_type: str) -> Endpoint:
        name = topic if topic.startswith("/") else f"{self._namespace}/{topic}"
        return endpoint(self._graph.domain, kind, name, ros_type, humble=self._clouds.is_humble)

    def _listen(self) -> None:
        if self._uses_frames:  # before the clouds, whose frames they connect
            frames = self._endpoint(PUBLISHER, self._topics.tf_static, static_transforms.TYPE)
            add = self._telling_bad_ones(lambda body: self._frames.add(decode_transforms(body)))
            self._listening += self._graph.subscribe(frames, add, latched=True)
        if self._topics.imu is not None:
            samples = self._endpoint(PUBLISHER, self._topics.imu, imu.TYPE)
            self._listening += self._graph.subscribe(samples, self._telling_bad_ones(self.fix.on_imu))
        self._listening += self._graph.subscribe(self._clouds, self.fix.on_cloud)

    def _rest(self) -> None:
        while self._listening:
            self._listening.pop().undeclare()

    def _telling_bad_ones(self, take: Callable[[bytes], None]) -> Callable[[bytes], None]:
        """Returns ``take`` that tells why a message cannot be used, once in a row."""

        def checked(body: bytes) -> None:
            try:
                take(body)
            except InputError as error:
                if str(error) != self._bad_message:
                    self._bad_message = str(error)
                    self._tell(self._namespace, self._bad_message)

        return checked

    def _lookup(self, target: str, source: str) -> Matrix | None:
        try:
            return self._frames.between(target, source)
        except NotFound:
            return None

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

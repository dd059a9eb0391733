"""The gateway's node in the ROS graph, and its subscriptions as rmw_zenoh declares them."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import zenoh
import zenoh.ext

from firstfix.ros.rmw_zenoh import (
    LATCHED_QOS,
    SENSOR_QOS,
    SUBSCRIPTION,
    Endpoint,
    Node,
)

NODE_NAME = "firstfix_gateway"


class Graph:
    """The gateway's node in the ROS graph: declares endpoints with their tokens."""

    def __init__(self, session: Any, domain: int) -> None:
        self.session = session
        self.domain = domain
        self._node = Node(domain, str(session.info.zid()), NODE_NAME)
        self._numbers = itertools.count(1)
        self._node_token = session.liveliness().declare_token(self._node.token)

    def close(self) -> None:
        """Remove the node from the graph."""
        self._node_token.undeclare()

    def token(self, of: Endpoint, qos: str) -> Any:
        """Declare the token of an endpoint."""
        return self.session.liveliness().declare_token(
            self._node.endpoint_token(next(self._numbers), of, qos)
        )

    def subscribe(
        self, publisher: Endpoint, take: Callable[[bytes], None], *, latched: bool = False
    ) -> list[Any]:
        """Subscribe to what a publisher sends.

        Args:
            take: called with each message, in a thread of zenoh.
            latched: the publisher keeps its last messages for late subscribers: they come first.

        Returns:
            the subscriber and its token, to be undeclared.
        """

        def on_sample(sample: Any) -> None:
            take(sample.payload.to_bytes())

        if latched:
            history = zenoh.ext.HistoryConfig(detect_late_publishers=True)
            subscriber = zenoh.ext.declare_advanced_subscriber(
                self.session, publisher.key, on_sample, history=history
            )
        else:
            subscriber = self.session.declare_subscriber(publisher.key, on_sample)
        qos = LATCHED_QOS if latched else SENSOR_QOS
        return [subscriber, self.token(replace(publisher, kind=SUBSCRIPTION), qos)]

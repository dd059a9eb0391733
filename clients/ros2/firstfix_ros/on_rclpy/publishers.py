"""Publishers of a robot's clouds, as the ROS graph tells them."""

from __future__ import annotations

import time
from collections import Counter

from rclpy.node import Node
from rclpy.qos import ReliabilityPolicy

from firstfix.ros import point_cloud2

from ..robot.cloud_types import CLOUD_TYPES

LOOK_S = 0.5  # between two looks at the graph
_UNKNOWN = "_NODE_NAME_UNKNOWN_"  # rmw's word until it has heard of the node


class Publishers:
    """The publishers of one topic of clouds.

    Args:
        topic: as the node resolves it.

    Attributes:
        are_reliable: all of them.
        cloud_type: of their messages; of several the first of CLOUD_TYPES.
        rivals: why their clouds cannot be told apart; empty: they can.
    """

    def __init__(self, node: Node, topic: str) -> None:
        self._node, self._topic = node, node.resolve_topic_name(topic)
        self._next_s = time.monotonic()
        self.are_reliable, self.rivals, self.cloud_type = False, "", point_cloud2.TYPE

    def look(self) -> None:
        """Look at the graph, twice a second."""
        if time.monotonic() < self._next_s:
            return
        self._next_s = time.monotonic() + LOOK_S
        there = self._node.get_publishers_info_by_topic(self._topic)
        types = {one.topic_type for one in there}
        self.cloud_type = next((one for one in CLOUD_TYPES if one in types), self.cloud_type)
        found = [one for one in there if one.topic_type == self.cloud_type]
        reliable = [one.qos_profile.reliability == ReliabilityPolicy.RELIABLE for one in found]
        self.are_reliable = bool(reliable) and all(reliable)
        nodes = Counter(f"{one.node_namespace.rstrip('/')}/{one.node_name}" for one in found)
        twice = sorted(name for name, count in nodes.items() if count > 1 and _UNKNOWN not in name)
        self.rivals = ""
        if twice:
            self.rivals = (
                f"{nodes[twice[0]]} nodes {twice[0]} publish {self._topic}: robots of one name, or one that "
                "has just started again. No pose until one of them is gone"
            )

"""Topics of a recording, and their messages as they were recorded."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import lru_cache

from ..formats.point_cloud import SCAN_LIMITS

MAX_MESSAGE_BYTES = SCAN_LIMITS.max_decoded_bytes + 1_000_000  # a cloud with its header and field names
MAX_CHUNK_BYTES = 2 * MAX_MESSAGE_BYTES  # a recorder closes a chunk after the message that fills it
ROS1, CDR, PROTOBUF = "ros1", "cdr", "protobuf"
_ROS1_TYPE = re.compile(r"\w+/\w+")


@dataclass(frozen=True, order=True)
class Topic:
    """Messages of one name, type and encoding.

    Attributes:
        type: as ROS 2 writes it, for messages of ROS 1 too: ``sensor_msgs/msg/PointCloud2``.
        encoding: ``cdr``, ``ros1``, ``protobuf`` ...
        count: number of its messages; None: not known before it is read.
    """

    name: str
    type: str
    encoding: str
    count: int | None


@dataclass(frozen=True, slots=True)
class RawMessage:
    """A serialised message of a recording.

    Attributes:
        time_ns: time of recording.
        type, encoding: see ``Topic``.
    """

    topic: str
    time_ns: int
    body: bytes | memoryview
    type: str
    encoding: str

    @property
    def ros1(self) -> bool:
        """Whether it is serialised as in ROS 1; otherwise, if it is ROS's, as CDR."""
        return self.encoding == ROS1


@lru_cache(1024)  # it is asked for every message
def ros2_type(name: str) -> str:
    """The name of a message type as ROS 2 writes it: ``pkg/Type`` of ROS 1 becomes ``pkg/msg/Type``."""
    package, _, message = name.partition("/")
    return f"{package}/msg/{message}" if _ROS1_TYPE.fullmatch(name) else name

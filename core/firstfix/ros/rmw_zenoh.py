"""Keys, liveliness tokens and attachments of rmw_zenoh_cpp (ROS 2 on zenoh). This module does not need zenoh.

Source: docs/design.md, liveliness_utils.cpp and attachment_helpers.cpp of ros2/rmw_zenoh. Jazzy's releases up
to 0.2.3 use other attachments and are not supported.

    topic  <domain>/<name without its first slash>/<DDS type>/<type hash>
    token  @ros2_lv/<domain>/<session>/<node id>/<id>/<kind>/<enclave>/<namespace>/<node>
           and for endpoints /<name>/<DDS type>/<type hash>/<QoS>, each part with % for its slashes
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

from ..errors import MalformedData
from .type_hashes import TYPE_HASHES

NO_HASH = "TypeHashNotSupported"  # Humble
NODE, PUBLISHER, SUBSCRIPTION, SERVICE = "NN", "MP", "MS", "SS"
# Differences from rmw_zenoh's defaults (reliable, volatile, depth 42): here the depth
RELIABLE_QOS = "::,10:,:,:,,"
SENSOR_QOS = "2::,5:,:,:,,"  # best effort
LATCHED_QOS = ":1:,100:,:,:,,"  # transient local
_ADMIN = "@ros2_lv"
_ATTACHMENT = struct.Struct("<qqB16s")
_GID_BYTES = 16


@dataclass(frozen=True)
class Endpoint:
    """A publisher, subscription or service, as described by its token."""

    domain: int
    kind: str
    topic: str
    dds_type: str
    type_hash: str

    @property
    def key(self) -> str:
        """Key of its messages."""
        return f"{self.domain}/{self.topic.strip('/')}/{self.dds_type}/{self.type_hash}"

    @property
    def is_humble(self) -> bool:
        """True on ROS 2 Humble, which has no type hashes."""
        return self.type_hash == NO_HASH


def endpoint(domain: int, kind: str, topic: str, ros_type: str, *, humble: bool = False) -> Endpoint:
    """Make an endpoint of this process.

    Args:
        topic: fully qualified, with the first slash.
        ros_type: one of ``TYPE_HASHES``.
    """
    return Endpoint(domain, kind, topic, dds_type(ros_type), NO_HASH if humble else TYPE_HASHES[ros_type])


def dds_type(ros_type: str) -> str:
    """The DDS name of ``pkg/msg/Type``."""
    package, kind, name = ros_type.split("/")
    return f"{package}::{kind}::dds_::{name}_"


def publishers_pattern(domain: int, ros_type: str) -> str:
    """A key expression for the tokens of all publishers of a type.

    Its last part matches the QoS, and the parts that Rolling adds.
    """
    return f"{_ADMIN}/{domain}/*/*/*/{PUBLISHER}/*/*/*/*/{dds_type(ros_type)}/**"


def subscriptions_pattern(publisher: Endpoint) -> str:
    """A key expression for the tokens of all subscriptions that hear a publisher."""
    topic = publisher.topic.replace("/", "%")
    parts = f"{_ADMIN}/{publisher.domain}/*/*/*/{SUBSCRIPTION}/*/*/*"
    return f"{parts}/{topic}/{publisher.dds_type}/{publisher.type_hash}/**"


def parse_token(key: str) -> Endpoint | None:
    """Parse the token of an endpoint. Returns None for any other key."""
    parts = key.split("/")
    if len(parts) < 13 or parts[0] != _ADMIN or not parts[1].isdigit() or not parts[9].startswith("%"):
        return None
    return Endpoint(int(parts[1]), parts[5], parts[9].replace("%", "/"), parts[10], parts[11])


@dataclass(frozen=True)
class Node:
    """A node without namespace or enclave, with number 0 in its session."""

    domain: int
    session: str
    name: str

    @property
    def token(self) -> str:
        """Liveliness token of the node."""
        return self._token(0, NODE)

    def endpoint_token(self, number: int, of: Endpoint, qos: str) -> str:
        """The liveliness token of an endpoint.

        Args:
            number: number of the endpoint in its session, from 1.
        """
        mangled = of.topic.replace("/", "%")
        return f"{self._token(number, of.kind)}/{mangled}/{of.dds_type}/{of.type_hash}/{qos}"

    def _token(self, number: int, kind: str) -> str:
        return f"{_ADMIN}/{self.domain}/{self.session}/0/{number}/{kind}/%/%/{self.name}"


@dataclass(frozen=True)
class Attachment:
    """Attachment of a message. rmw_zenoh drops messages without one.

    Attributes:
        sequence: number of the message, from 1. In a reply: of the request.
        stamp_ns: time of sending, since the epoch.
        gid: 16 bytes that identify the sender. In a reply: the sender of the request.
    """

    sequence: int
    stamp_ns: int
    gid: bytes

    def to_bytes(self) -> bytes:
        """Encode the attachment."""
        return _ATTACHMENT.pack(self.sequence, self.stamp_ns, _GID_BYTES, self.gid)

    @classmethod
    def from_bytes(cls, raw: bytes) -> Attachment:
        """Decode an attachment.

        Raises:
            MalformedData: another layout.
        """
        if len(raw) != _ATTACHMENT.size or raw[16] != _GID_BYTES:
            raise MalformedData(f"{len(raw)} bytes are not an attachment of rmw_zenoh")
        sequence, stamp_ns, _, gid = _ATTACHMENT.unpack(raw)
        return cls(sequence, stamp_ns, gid)

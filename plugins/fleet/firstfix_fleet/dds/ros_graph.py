"""The gateway's node in the ROS graph, as every rmw over DDS tells it: ``ros2 node list`` shows it.

Bridges between DDS and other networks carry the topics of nodes alone, so without a node they would leave the
gateway's out.
"""

from __future__ import annotations

import os
import weakref
from typing import Any

from cyclonedds.core import Entity, Policy, Qos
from cyclonedds.idl import make_idl_struct
from cyclonedds.idl.types import array, bounded_str, sequence, uint8
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from firstfix.ros.rmw_zenoh import dds_type
from firstfix.ros.type_hashes import DISCOVERY

from .qos import with_type_hash

TOPIC = "ros_discovery_info"  # without a prefix, unlike ROS's other topics
NAMESPACE, NAME = "/", "firstfix_gateway"
_QOS = Qos(
    Policy.Reliability.Reliable(duration(milliseconds=100)),
    Policy.Durability.TransientLocal,
    Policy.History.KeepLast(1),
)
_GID_BYTES = 16
_OLD_GID_BYTES, _OLD_DISTRIBUTIONS = 24, {"dashing", "eloquent", "foxy", "galactic", "humble"}


class RosGraph:
    """Tells which readers and writers of a participant belong to the gateway's node.

    The bytes of an identity are 24 up to Humble, and 16 since: ``ROS_DISTRO`` says which the robots have.
    """

    def __init__(self, participant: Entity, distribution: str | None = None) -> None:
        name = os.environ.get("ROS_DISTRO", "") if distribution is None else distribution
        self._gid_bytes = _OLD_GID_BYTES if name in _OLD_DISTRIBUTIONS else _GID_BYTES
        self._types = _types(self._gid_bytes)
        self._participant = participant
        of_today = self._gid_bytes == _GID_BYTES
        qos = with_type_hash(_QOS, DISCOVERY) if of_today else _QOS  # Humble knows no hashes
        self._writer = DataWriter(participant, Topic(participant, TOPIC, self._types["info"]), qos)
        # An entity is gone as soon as nobody holds it, so it must not be held here.
        self._readers: weakref.WeakKeyDictionary[Any, bytes] = weakref.WeakKeyDictionary()
        self._writers: weakref.WeakKeyDictionary[Any, bytes] = weakref.WeakKeyDictionary()
        self._published: tuple[list[bytes], list[bytes]] | None = None

    def add_reader(self, reader: DataReader[Any]) -> None:
        """Add a reader for as long as it is held elsewhere."""
        self._readers[reader] = self._gid(reader)

    def add_writer(self, writer: DataWriter[Any]) -> None:
        """Add a writer for as long as it is held elsewhere."""
        self._writers[writer] = self._gid(writer)

    def publish_changes(self) -> None:
        """Publish all readers and writers anew, if there are others than the last time."""
        now = sorted(self._readers.values()), sorted(self._writers.values())
        if now == self._published:
            return
        self._published = now
        gid = self._types["gid"]
        readers, writers = ([gid(data=[*one]) for one in gids] for gids in now)
        node = self._types["node"](
            node_namespace=NAMESPACE, node_name=NAME, reader_gid_seq=readers, writer_gid_seq=writers
        )
        own = gid(data=[*self._gid(self._participant)])
        self._writer.write(self._types["info"](gid=own, node_entities_info_seq=[node]))

    def _gid(self, entity: Entity) -> bytes:
        guid = entity.guid
        assert guid is not None
        return guid.bytes.ljust(self._gid_bytes, b"\0")


def _types(gid_bytes: int) -> dict[str, Any]:
    """The messages of rmw_dds_common."""

    def struct(message: str, fields: dict[str, Any]) -> Any:
        name = dds_type(f"rmw_dds_common/msg/{message}")
        return make_idl_struct(name.rpartition("::")[2], name, fields)

    gid = struct("Gid", {"data": array[uint8, gid_bytes]})
    node = struct(
        "NodeEntitiesInfo",
        {
            "node_namespace": bounded_str[256],
            "node_name": bounded_str[256],
            "reader_gid_seq": sequence[gid],
            "writer_gid_seq": sequence[gid],
        },
    )
    info = struct("ParticipantEntitiesInfo", {"gid": gid, "node_entities_info_seq": sequence[node]})
    return {"gid": gid, "node": node, "info": info}

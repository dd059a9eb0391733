"""The gateway's node is in the ROS graph, in the bytes of rmw_dds_common's definitions."""

from __future__ import annotations

from typing import Any

import pytest
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import make_idl_struct
from cyclonedds.idl.types import array, bounded_str, sequence, uint8
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from firstfix_fleet.dds import qos
from firstfix_fleet.dds.participant import Participant
from tests.claimed import any_domain
from tests.dds_loopback import LOOPBACK
from tests.waiting import wait_until

CLOUD, POSE = "sensor_msgs/msg/PointCloud2", "geometry_msgs/msg/PoseWithCovarianceStamped"
INFO = "rmw_dds_common/msg/ParticipantEntitiesInfo"
NODE = "string<=256 node_namespace\nstring<=256 node_name\nGid[] reader_gid_seq\nGid[] writer_gid_seq"


def typestore(gid_bytes: int) -> Any:
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(f"uint8[{gid_bytes}] data", "rmw_dds_common/msg/Gid"))
    store.register(get_types_from_msg(NODE, "rmw_dds_common/msg/NodeEntitiesInfo"))
    store.register(get_types_from_msg("Gid gid\nNodeEntitiesInfo[] node_entities_info_seq", INFO))
    return store


def listener(participant: DomainParticipant, gid_bytes: int) -> Any:
    """A reader that gives the samples' bytes."""

    def struct(name: str, fields: dict[str, Any]) -> Any:
        return make_idl_struct(f"{name}_", f"rmw_dds_common::msg::dds_::{name}_", fields)

    gid = struct("Gid", {"data": array[uint8, gid_bytes]})
    names = {"node_namespace": bounded_str[256], "node_name": bounded_str[256]}
    gids = {"reader_gid_seq": sequence[gid], "writer_gid_seq": sequence[gid]}
    fields = {"gid": gid, "node_entities_info_seq": sequence[struct("NodeEntitiesInfo", names | gids)]}
    kind = struct("ParticipantEntitiesInfo", fields)

    def as_bytes(cls: Any, data: bytes, *args: Any, **options: Any) -> Any:
        made = cls.__new__(cls)
        made.body = data
        return made

    kind.deserialize = classmethod(as_bytes)
    return DataReader(participant, Topic(participant, "ros_discovery_info", kind), qos.latched(10))


@pytest.mark.parametrize(("distribution", "gid_bytes"), [("humble", 24), ("jazzy", 16), ("", 16)])
def test_the_node_and_its_topics_are_told_as_they_change(
    monkeypatch: pytest.MonkeyPatch, distribution: str, gid_bytes: int
):
    monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK)
    monkeypatch.setenv("ROS_DISTRO", distribution)
    domain, store = any_domain(), typestore(gid_bytes)
    gateway = Participant(domain)
    others = DomainParticipant(domain)
    heard = listener(others, gid_bytes)
    told: list[Any] = []

    def last() -> Any:
        gateway.wait(0.0)
        for sample in heard.take(10):
            message = store.deserialize_cdr(sample.body, INFO)
            assert bytes(store.serialize_cdr(message, INFO)) == sample.body
            told.append(message)
        return told[-1].node_entities_info_seq[0] if told else None

    def gids(sequence_of: Any) -> set[bytes]:
        return {bytes(one.data) for one in sequence_of}

    wait_until(last)
    assert (last().node_namespace, last().node_name) == ("/", "firstfix_gateway")
    assert bytes(told[-1].gid.data) == gateway.entity.guid.bytes.ljust(gid_bytes, b"\0")
    reader = gateway.read("rt/r1/points", CLOUD, qos.sensor_data(1), lambda body, info: None)
    writer = gateway.writer("rt/r1/initialpose", POSE, qos.reliable(1))
    wait_until(lambda: last().reader_gid_seq and last().writer_gid_seq)
    assert gids(last().reader_gid_seq) == {reader.guid.bytes.ljust(gid_bytes, b"\0")}
    assert len(gids(last().writer_gid_seq)) == 1
    gateway.stop_reading(reader)
    del reader, writer
    wait_until(lambda: not last().reader_gid_seq and not last().writer_gid_seq)

"""The gateway's participant in a DDS domain: readers that hand over bytes, and writers that take them."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from typing import Any

from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication
from cyclonedds.core import (
    DDSException,
    Entity,
    InstanceState,
    Qos,
    ReadCondition,
    SampleState,
    ViewState,
    WaitSet,
)
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from firstfix.errors import InvalidOption
from firstfix_ros.robot.gateway import MAX_CLOUD_BYTES

from .messages import TYPES, body_of, sample_of
from .qos import with_type_hash
from .ros_graph import RosGraph

TOPIC, REQUEST, REPLY = "rt", "rq", "rr"  # ROS 2's prefixes of topics, service requests and replies
_ANY = SampleState.Any | ViewState.Any | InstanceState.Any
_AT_ONCE = 100  # samples of a reader that are taken in one turn
# For networks that drop datagrams. By Cyclone DDS's own defaults, it announces itself every 8 s, for 10 s:
# with one announcement lost, a robot may take the gateway for gone, and not find its topics again. And it
# waits 100 ms before it asks again for what was lost of a cloud.
_LOSSY = (
    "<CycloneDDS><Domain><Discovery>"
    "<SPDPInterval>1 s</SPDPInterval><LeaseDuration>30 s</LeaseDuration>"
    "</Discovery><Internal>"
    "<NackDelay>10 ms</NackDelay><AutoReschedNackDelay>100 ms</AutoReschedNackDelay>"
    "</Internal></Domain></CycloneDDS>"
)
# Larger samples are dropped before memory is taken for them; a PointCloud2 has its header, too.
_LIMITS = (
    "<CycloneDDS><Domain><Internal>"
    f"<MaxSampleSize>{MAX_CLOUD_BYTES + 4096} B</MaxSampleSize>"
    "</Internal></Domain></CycloneDDS>"
)
# Fast DDS 3 (Kilted) sends type information that Cyclone DDS 0.10 takes for invalid, and matches nothing.
# Without it, types are matched by their names, as up to Jazzy.
_BY_NAME = (
    "<CycloneDDS><Domain><Compatibility>"
    "<IgnoreTypeInformation>1.15</IgnoreTypeInformation>"
    "</Compatibility></Domain></CycloneDDS>"
)
Take = Callable[[bytes, Any], None]  # a body, and cyclonedds' information on its sample


class Participant:
    """The gateway's participant. All of it is used by one thread, but for ``write``.

    Args:
        domain: ROS_DOMAIN_ID.

    Raises:
        InvalidOption: no such domain, or CYCLONEDDS_URI or the network does not allow it.
    """

    def __init__(self, domain: int) -> None:
        # Of two parts that set the same, the later one counts.
        parts = (_LOSSY, _BY_NAME, os.environ.get("CYCLONEDDS_URI", ""), _LIMITS)
        config = ",".join(part for part in parts if part)
        try:
            self._domain = Domain(domain, config)
            self.entity = DomainParticipant(domain)
            self._publications = BuiltinDataReader(self.entity, BuiltinTopicDcpsPublication)
        except (DDSException, UnicodeEncodeError) as error:
            raise InvalidOption(f"cannot join the DDS domain {domain}: {error}") from None
        self._graph = RosGraph(self.entity)
        self._waitset = WaitSet(self.entity)
        self._changes = self._attached(self._publications)
        self._topics: dict[tuple[str, str], Any] = {}
        self._readers: dict[DataReader[Any], tuple[ReadCondition, Take]] = {}

    def read(self, topic: str, ros_type: str, qos: Qos, take: Take) -> DataReader[Any]:
        """Begin to read a topic.

        Args:
            topic: with ROS's prefix: ``rt/points``.
            take: called in the thread of ``wait``.

        Raises:
            ConnectionError: DDS does not allow this topic.
        """
        reader = DataReader(self.entity, self._topic(topic, ros_type), with_type_hash(qos, ros_type))
        self._graph.add_reader(reader)
        self._readers[reader] = self._attached(reader), take
        return reader

    def stop_reading(self, reader: DataReader[Any]) -> None:
        """Remove a reader."""
        condition, _ = self._readers.pop(reader)
        self._waitset.detach(condition)
        del condition

    def writer(self, topic: str, ros_type: str, qos: Qos) -> Writer:
        """Make a writer of a topic.

        Raises:
            ConnectionError: DDS does not allow this topic.
        """
        writer = DataWriter(self.entity, self._topic(topic, ros_type), with_type_hash(qos, ros_type))
        self._graph.add_writer(writer)
        return Writer(writer, TYPES[ros_type])

    def wait(self, timeout_s: float) -> None:
        """Wait for messages, and hands over those that are there."""
        self._graph.publish_changes()
        self._waitset.wait(duration(seconds=timeout_s))
        for reader, (_, take) in list(self._readers.items()):
            if reader in self._readers:  # not removed by another's message
                for sample in reader.take(_AT_ONCE):
                    body = body_of(sample)
                    if body is not None:
                        take(body, sample.sample_info)

    def publications(self) -> Iterator[Any]:
        """Yield the publishers that came and went since the last call, as cyclonedds describes them.

        Of one that went, ``topic_name`` is None.
        """
        while found := self._publications.take(_AT_ONCE):
            yield from found

    def _attached(self, reader: Entity) -> ReadCondition:
        condition = ReadCondition(reader, _ANY)
        self._waitset.attach(condition)
        return condition

    def _topic(self, topic: str, ros_type: str) -> Any:
        key = topic, ros_type
        if key not in self._topics:
            try:
                self._topics[key] = Topic(self.entity, topic, TYPES[ros_type])
            except (DDSException, UnicodeError) as error:
                raise ConnectionError(f"DDS refuses the topic {topic[:200]!r}: {error}") from None
        return self._topics[key]


class Writer:
    """Writes bodies to one topic, in any thread."""

    def __init__(self, writer: DataWriter[Any], kind: Any) -> None:
        self._writer, self._kind = writer, kind

    def write(self, body: bytes) -> None:
        """Write a message in CDR.

        Raises:
            ConnectionError: a reliable reader does not keep up.
        """
        try:
            self._writer.write(sample_of(self._kind, body))
        except DDSException as error:
            raise ConnectionError(f"DDS did not take a message: {error}") from None

    def readers(self) -> list[Any]:
        """The participants of the matched readers."""
        found = [self._writer.get_matched_subscription_data(one) for one in self._writer.matched_sub]
        return [one.participant_key for one in found if one is not None]

"""Ouster's packets in a bag, and its captures (.pcap) and recordings (.osf), as ouster-sdk decodes them.

The SDK runs in a process of its own: metadata and packets that it cannot bear end it, and nothing else.
"""

from __future__ import annotations

from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

from ..errors import MalformedData, pip_install
from ..ros.cdr import MessageReader
from ..ros.point_cloud2 import StampedCloud
from . import ouster_sdk
from .clouds import DecodedCloud, RecordedCloud, named, where
from .confined_process import ConfinedProcess
from .messages import RawMessage
from .whole_turns import WholeTurns

TYPES = tuple(f"{package}/msg/PacketMsg" for package in ("ouster_ros", "ouster_sensor_msgs", "ouster_msgs"))
LIDAR_TOPIC = "lidar_packets"  # its IMU's packets are messages of the same type
_MAX_METADATA_BYTES = 1_000_000


def metadata_topic(topic: str) -> str:
    """The topic of the sensor's metadata, beside that of its packets."""
    return topic.rpartition("/")[0] + "/metadata"


def decode_metadata(message: RawMessage) -> str:
    """The text of a std_msgs/String with a sensor's metadata.

    Raises:
        MalformedData: not such a message.
    """
    reader = MessageReader("String", message.body, ros1=message.ros1)
    text = bytes(reader.octets()).rstrip(b"\0")
    reader.end()
    if len(text) > _MAX_METADATA_BYTES:
        reader.fail(f"{len(text)} bytes of metadata, the limit is {_MAX_METADATA_BYTES}")
    return text.decode(errors="replace")


class OusterPackets:
    """Reader of the packets of one sensor, see ``CloudReader``.

    Args:
        metadata: of the sensor, as JSON.
        bag: name of the recording, for errors.

    Raises:
        MalformedData: the metadata is not of an Ouster.
        ModuleNotFoundError: ouster-sdk is not installed.
    """

    def __init__(self, metadata: str, bag: str) -> None:
        check_installed()
        self._bag = bag
        self._process = ConfinedProcess()
        self._turns = self._process.talk(ouster_sdk.turns_of_packets, metadata)
        self._packet_bytes = self._turns.send()
        self._whole: WholeTurns[DecodedCloud] = WholeTurns(lambda turn: turn.decoded)
        self._last: tuple[str, int] | None = None

    def add(self, message: RawMessage) -> list[RecordedCloud]:
        """Take the next packet. Returns the clouds that were complete before it."""
        with named(where(self._bag, message.topic, message.time_ns)):
            reader = MessageReader("PacketMsg", message.body, ros1=message.ros1)
            data = reader.octets()
            reader.end()
            size = self._packet_bytes
            if len(data) not in (size, size + 1):  # drivers before 2023 sent one byte more
                reader.fail(f"a packet of {len(data)} bytes, and the sensor's metadata says {size}")
            done = self._sent((bytes(data[:size]), message.time_ns))
        self._last = (message.topic, message.time_ns)
        return done

    def end(self) -> list[RecordedCloud]:
        """The clouds that the last packets have begun."""
        done = self._sent(None)
        self._process.close()
        return [*done, *self._whole.end()]

    def _sent(self, packet: tuple[bytes, int] | None) -> list[RecordedCloud]:
        found = self._turns.send(packet)
        if isinstance(found, MalformedData):
            raise found
        if found is None or self._last is None:
            return []
        return [*self._whole.add(DecodedCloud(*self._last, found))]


class OusterFile:
    """A capture or an .osf file.

    Args:
        process: in which the SDK runs.

    Attributes:
        sensors: how many there are.

    Raises:
        NotFound: no metadata of the sensor beside a capture.
        MalformedData: damaged.
        ModuleNotFoundError: ouster-sdk is not installed.
    """

    def __init__(self, path: Path, process: ConfinedProcess) -> None:
        check_installed()
        self._path, self._process = path, process
        self.sensors = process.run(ouster_sdk.sensors_of_file, path)

    def turns(self, sensor: int) -> Iterator[StampedCloud]:
        """Yield the turns of one sensor.

        Raises:
            MalformedData: damaged.
        """
        return self._process.talk(ouster_sdk.clouds_of_file, self._path, sensor)


def check_installed() -> None:
    """Check that the SDK is there.

    Raises:
        ModuleNotFoundError: it is not installed.
    """
    if find_spec("ouster") is None:
        raise ModuleNotFoundError(
            f"recordings of an Ouster need the package ouster-sdk: {pip_install('.[ouster]')}", name="ouster"
        )

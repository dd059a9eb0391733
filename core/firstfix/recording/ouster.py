"""Ouster's packets in a bag, and its captures (.pcap) and recordings (.osf), decoded by ouster-sdk.

A cloud is in the sensor's frame: the LiDAR's own, which the beams are given in, is turned by 180 degrees and
lies 36 mm higher. Each column of the picture has its time. Pixels without a return are left out: the SDK puts
them in the origin.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import FirstfixError, MalformedData, NotFound, pip_install
from ..formats.point_cloud import SCAN_LIMITS, PointCloud
from ..ros.cdr import MessageReader
from ..ros.header import Header, Stamp
from ..ros.point_cloud2 import StampedCloud
from .clouds import DecodedCloud, RecordedCloud, named, where
from .messages import RawMessage

TYPES = tuple(f"{package}/msg/PacketMsg" for package in ("ouster_ros", "ouster_sensor_msgs", "ouster_msgs"))
LIDAR_TOPIC = "lidar_packets"  # its IMU's packets are messages of the same type
FRAME = "os_sensor"  # as its driver names it
_MAX_METADATA_BYTES = 1_000_000
_MAX_COLUMNS, _MAX_PIXELS = 8192, 1024  # four times those of any sensor
_PER_PACKET = re.compile(r'"columns_per_packet"\s*:\s*(\d+)')


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
        self._sdk = _sdk()
        self._bag = bag
        with _of_sdk("the sensor's metadata"):
            self._info = self._sdk.SensorInfo(metadata)
            _check_size(self._info)
            self._format = self._sdk.PacketFormat(self._info)
            self._batcher = self._sdk.FrameBatcher(self._info)
            self._frame = self._sdk.LidarFrame(self._info)
            self._cloud_of = frame_decoder(self._info)
        self._last: tuple[str, int] | None = None

    def add(self, message: RawMessage) -> list[RecordedCloud]:
        """Take the next packet. Returns the cloud that was complete before it."""
        with named(where(self._bag, message.topic, message.time_ns)):
            reader = MessageReader("PacketMsg", message.body, ros1=message.ros1)
            data = reader.octets()
            reader.end()
            size = self._format.lidar_packet_size
            if len(data) not in (size, size + 1):  # drivers before 2023 sent one byte more
                reader.fail(f"a packet of {len(data)} bytes, and the sensor's metadata says {size}")
            with _of_sdk("a packet"):
                packet = self._sdk.LidarPacket(self._format)
                packet.buf[:] = np.frombuffer(data[:size], np.uint8)
                packet.host_timestamp = message.time_ns
                if not self._batcher.batch(packet, self._frame):
                    self._last = (message.topic, message.time_ns)
                    return []
        done = self._done()
        self._last = (message.topic, message.time_ns)
        return done

    def end(self) -> list[RecordedCloud]:
        """The cloud that the last packets have begun."""
        return self._done()

    def _done(self) -> list[RecordedCloud]:
        with _of_sdk("a turn"):
            frame, self._frame = self._frame, self._sdk.LidarFrame(self._info)
            found = None if self._last is None else self._cloud_of(frame)
        if self._last is None or found is None:
            return []
        return [DecodedCloud(*self._last, found)]


def clouds_of_file(path: Path, sensor: int) -> Iterator[StampedCloud]:
    """Yield the turns of one sensor of a capture or an .osf file.

    Raises:
        MalformedData: damaged.
        ModuleNotFoundError: ouster-sdk is not installed.
    """
    with _of_sdk(path.name):
        source = _opened(path)
        cloud_of = frame_decoder(source.sensor_info[sensor])
        for frames in source:
            frame = frames[sensor]
            cloud = None if frame is None else cloud_of(frame)
            if cloud is not None:
                yield cloud


def sensors_of_file(path: Path) -> int:
    """The number of sensors in a capture or an .osf file.

    Raises:
        NotFound: no metadata of the sensor beside a capture.
        MalformedData, ModuleNotFoundError: as ``clouds_of_file``.
    """
    with _of_sdk(path.name):
        return len(_opened(path).sensor_info)


def _check_size(info: Any) -> None:
    """Check the picture's size before the SDK makes room for it."""
    columns, pixels = info.format.columns_per_frame, info.format.pixels_per_column
    if not (0 < columns <= _MAX_COLUMNS and 0 < pixels <= _MAX_PIXELS):
        raise MalformedData(f"the sensor's metadata: a picture of {columns} columns of {pixels} pixels")


def _check_beside(capture: Path) -> None:
    """Check the metadata beside a capture for what ends the SDK's process: it divides by this number."""
    for beside in capture.parent.glob("*.json"):
        if beside.stat().st_size > _MAX_METADATA_BYTES or beside.name[0] != capture.name[0]:
            continue
        for digits in _PER_PACKET.findall(beside.read_text(errors="replace")):
            if int(digits) == 0:
                raise MalformedData(f"{beside.name}: columns_per_packet is 0")


def _opened(path: Path) -> Any:
    _sdk()
    _check_beside(path)
    from ouster.sdk.open_source import open_source

    try:
        source = open_source(str(path), collate=True)
    except Exception as error:
        if "metadata" not in str(error).lower() or path.suffix == ".osf":
            raise
        raise NotFound(
            f"{path}: no metadata of its sensor. Put the JSON file that the sensor gives (http://SENSOR/api/v1/sensor/"
            f"metadata) beside it, with the same beginning of its name: {path.stem}.json"
        ) from error
    for info in source.sensor_info:
        _check_size(info)
    return source


def frame_decoder(info: Any) -> Callable[[Any], StampedCloud | None]:
    """Make the function that turns a sensor's LidarFrame into a cloud; None: it has no point."""
    place = _sdk().XYZLut(info, use_extrinsics=False)
    rings = np.arange(info.format.pixels_per_column, dtype=np.uint16)

    def cloud(frame: Any) -> StampedCloud | None:
        ranges = frame.field("RANGE")
        times_ns = frame.timestamp.astype(np.int64)
        taken = (ranges > 0) & ((frame.status & 1) > 0)[None, :]
        if not taken.any():
            return None
        SCAN_LIMITS.check("ouster", int(taken.sum()), 24)
        first_ns = int(times_ns[taken.any(axis=0)].min())
        xyz = place(ranges)[taken]
        columns = {axis: xyz[:, number].astype(np.float32) for number, axis in enumerate("xyz")}
        for name in ("REFLECTIVITY", "SIGNAL"):
            if frame.has_field(name):
                columns["intensity"] = frame.field(name)[taken]
                break
        columns["t"] = np.broadcast_to((times_ns - first_ns).astype(np.uint32)[None, :], taken.shape)[taken]
        columns["ring"] = np.broadcast_to(rings[:, None], taken.shape)[taken]
        return StampedCloud(Header(Stamp.of_ns(first_ns), FRAME), PointCloud(columns))

    return cloud


@contextmanager
def _of_sdk(what: str) -> Iterator[None]:
    """Turn the exceptions of the SDK, of which it has many, into MalformedData."""
    try:
        yield
    except (FirstfixError, ModuleNotFoundError):
        raise
    except Exception as error:
        raise MalformedData(f"{what}: {str(error) or type(error).__name__}") from error


def _sdk() -> Any:
    try:
        import ouster.sdk.core as sdk
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            f"recordings of an Ouster need the package ouster-sdk: {pip_install('.[ouster]')}",
            name=error.name,
        ) from error
    return sdk

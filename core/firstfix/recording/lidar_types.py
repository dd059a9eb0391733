"""The table of message types that hold a LiDAR's data: what reads each, or what makes clouds of it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from ..errors import MalformedData, NotFound
from ..ros import point_cloud2
from . import capture_file, compressed_cloud, foxglove, livox, ouster, point_cloud1, velodyne
from .clouds import CloudReader, Decode, DecodedCloud, OneByOne, RecordedCloud
from .messages import CDR, PROTOBUF, ROS1, RawMessage, Topic

if TYPE_CHECKING:
    from .recording import Recording

_Open = Callable[["Recording", Topic], CloudReader]
_ROS = frozenset({CDR, ROS1})


def _each(decode: Decode) -> _Open:
    return lambda recording, _: OneByOne(decode, str(recording.path))


def _compressed(recording: Recording, _: Topic) -> CloudReader:
    return OneByOne(compressed_cloud.compressed_decoder(), str(recording.path))


def _velodyne(recording: Recording, _: Topic) -> CloudReader:
    return OneByOne(velodyne.velodyne_decoder(), str(recording.path))


def _foxglove(recording: Recording, topic: Topic) -> CloudReader:
    decode = foxglove.foxglove_decoder(recording.schema(topic))
    return OneByOne(decode, str(recording.path), lambda message: foxglove.header_of(decode, message))


def _ouster(recording: Recording, topic: Topic) -> CloudReader:
    name = ouster.metadata_topic(topic.name)
    given = next(recording.messages([name]), None)
    beside = recording.path.with_suffix(".json")
    if given is not None:
        metadata = ouster.decode_metadata(given)
    elif beside.is_file():
        metadata = beside.read_text(errors="replace")
    else:
        raise NotFound(
            f"{recording.path}: {topic.name} needs the sensor's metadata, and there is none in {name}: put "
            f"the JSON file that the sensor gives beside the recording, as {beside.name}"
        )
    return ouster.OusterPackets(metadata, str(recording.path))


class _Captured:
    """Reader of what a capture's library has decoded, see ``CloudReader``."""

    def add(self, message: RawMessage) -> list[RecordedCloud]:
        """The cloud that comes with the message."""
        if not isinstance(message, capture_file.CapturedTurn):
            raise MalformedData(f"{message.topic}: no turn of a capture")
        return [DecodedCloud(message.topic, message.time_ns, message.cloud)]

    def end(self) -> list[RecordedCloud]:
        """None."""
        return []


_POINT_CLOUD2 = (_ROS, _each(lambda m, limits: point_cloud2.decode_point_cloud2(m.body, limits, ros1=m.ros1)))
# In the order of choice: where a bag has a topic of an upper row, those of lower rows are the same LiDAR's.
READERS: dict[str, tuple[frozenset[str], _Open]] = {
    point_cloud2.TYPE: _POINT_CLOUD2,
    **dict.fromkeys(livox.TYPES, (_ROS, _each(livox.decode_livox))),
    foxglove.TYPE: (frozenset({PROTOBUF}), _foxglove),
    point_cloud1.TYPE: (_ROS, _each(point_cloud1.decode_point_cloud1)),
    compressed_cloud.TYPE: (_ROS, _compressed),
    velodyne.TYPE: (_ROS, _velodyne),
    **dict.fromkeys(ouster.TYPES, (_ROS, _ouster)),
    capture_file.TYPE: (frozenset({capture_file.ENCODING}), lambda *_: _Captured()),
}
_ORDER = list(READERS)
_OF_MAKER = "play the bag through the maker's driver, and record the PointCloud2 that it sends"
# What a type name begins with, and what turns such messages into clouds.
_NOT_TAKEN = {
    "hesai_ros_driver/": _OF_MAKER,
    "pandar_msgs/": f"{_OF_MAKER} (nebula reads them too)",
    "nebula_msgs/": "play the bag through nebula, and record the PointCloud2 that it sends",
    "rslidar_msg/": _OF_MAKER,
    "rslidar_msgs/": _OF_MAKER,
    "seyond/": _OF_MAKER,
    "velodyne_msgs/": _OF_MAKER,
    "livox_": "record with xfer_format 0 of its driver, which sends PointCloud2, or 1, which sends CustomMsg",
    "foxglove_msgs/msg/PointCloud": "record foxglove.PointCloud in protobuf, or PointCloud2",
    "sensor_msgs/msg/LaserScan": "a plane of points is no scan of a 3-D map",
    "sensor_msgs/msg/MultiEchoLaserScan": "a plane of points is no scan of a 3-D map",
}


def has_clouds(topic: Topic) -> bool:
    """Whether clouds can be read from a topic."""
    encodings, _ = READERS.get(topic.type, (frozenset(), None))
    if topic.type in ouster.TYPES and not topic.name.endswith(ouster.LIDAR_TOPIC):
        return False
    return topic.encoding in encodings


def preference(topic: Topic) -> int:
    """The row of the table: packets are asked for only where there are no clouds."""
    return _ORDER.index(topic.type)


def cloud_reader(recording: Recording, topic: Topic) -> CloudReader:
    """Make the reader of a topic that ``has_clouds``.

    Raises:
        NotFound, MalformedData: what the reader needs is not in the recording, or damaged.
        ModuleNotFoundError: a package that the type needs is not installed.
    """
    return READERS[topic.type][1](recording, topic)


def remedy(topic: Topic) -> str | None:
    """Way to clouds for a topic with a LiDAR's data in a form that is not read; None: no LiDAR's."""
    if has_clouds(topic) or topic.type in ouster.TYPES:
        return None
    if topic.type in READERS:
        return f"record it in {' or '.join(sorted(READERS[topic.type][0]))}: {topic.encoding} is not read"
    return next((said for begin, said in _NOT_TAKEN.items() if topic.type.startswith(begin)), None)

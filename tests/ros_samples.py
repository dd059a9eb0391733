"""ROS messages and bags as rosbags writes them: what our own readers and writers are held against."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import lz4.frame
import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from firstfix.transform import quaternion_of

ROS2 = get_typestore(Stores.ROS2_HUMBLE)
ROS1 = get_typestore(Stores.ROS1_NOETIC)
ROS1.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage"))

CLOUD, IMU, TF = "sensor_msgs/msg/PointCloud2", "sensor_msgs/msg/Imu", "tf2_msgs/msg/TFMessage"
BAG_KINDS = ("ros1", "ros1 lz4", "sqlite3", "mcap", "mcap file")
PACKED_BAG_KINDS = (
    "ros1 bz2",
    *(f"{storage} zstd {mode}" for storage in ("sqlite3", "mcap") for mode in ("file", "message")),
    "mcap zstd chunk",
    "mcap lz4 chunk",
)
DATATYPES = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8, "i8": 9, "u8": 10}


def header(stores: Any, stamp_ns: int, frame_id: str) -> Any:
    time = stores.types["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 10**9))
    seq = {"seq": 7} if stores is ROS1 else {}
    return stores.types["std_msgs/msg/Header"](stamp=time, frame_id=frame_id, **seq)


def cloud(
    records: np.ndarray,
    *,
    stores: Any = ROS2,
    stamp_ns: int = 1_700_000_000_250_000_001,
    frame_id: str = "os_sensor",
    row_padding: int = 0,
    **replaced: Any,
) -> Any:
    """A PointCloud2 of structured records (n,) or, organised, (height, width). Byte order as the records'."""
    rows = np.atleast_2d(records)
    height, width = rows.shape
    dtype = rows.dtype
    row_step = width * dtype.itemsize + row_padding
    data = np.zeros((height, row_step), np.uint8)
    data[:, : width * dtype.itemsize] = np.frombuffer(rows.tobytes(), np.uint8).reshape(height, -1)
    fields = [
        stores.types["sensor_msgs/msg/PointField"](
            name, dtype.fields[name][1], DATATYPES[dtype[name].str[1:]], 1
        )
        for name in dtype.names
    ]
    values = {
        "header": header(stores, stamp_ns, frame_id),
        "height": height,
        "width": width,
        "fields": fields,
        "is_bigendian": dtype["x"].str[0] == ">",
        "point_step": dtype.itemsize,
        "row_step": row_step,
        "data": data.ravel(),
        "is_dense": False,
    }
    return stores.types[CLOUD](**(values | replaced))


def cloud_of_points(points: np.ndarray, **options: Any) -> Any:
    """(n, 3) points as float32 x, y, z."""
    records = np.zeros(len(points), [("x", "<f4"), ("y", "<f4"), ("z", "<f4")])
    for axis, name in enumerate("xyz"):
        records[name] = points[:, axis]
    return cloud(records, **options)


def imu(
    acceleration: Sequence[float], *, stores: Any = ROS2, stamp_ns: int = 0, frame_id: str = "imu"
) -> Any:
    types = stores.types
    vector, nine = types["geometry_msgs/msg/Vector3"], np.arange(9.0)
    return types[IMU](
        header=header(stores, stamp_ns, frame_id),
        orientation=types["geometry_msgs/msg/Quaternion"](0.1, 0.2, 0.3, 0.4),
        orientation_covariance=nine,
        angular_velocity=vector(1.0, 2.0, 3.0),
        angular_velocity_covariance=nine,
        linear_acceleration=vector(*acceleration),
        linear_acceleration_covariance=nine,
    )


def transforms(parent_child_T: Iterable[tuple[str, str, np.ndarray]], *, stores: Any = ROS2) -> Any:
    types = stores.types
    stamped = [
        types["geometry_msgs/msg/TransformStamped"](
            header(stores, 5, parent),
            child,
            types["geometry_msgs/msg/Transform"](
                types["geometry_msgs/msg/Vector3"](*T[:3, 3]),
                types["geometry_msgs/msg/Quaternion"](*quaternion_of(T)),
            ),
        )
        for parent, child, T in parent_child_T
    ]
    return types[TF](stamped)


def cdr(message: Any, *, little_endian: bool = True) -> bytes:
    return bytes(ROS2.serialize_cdr(message, message.__msgtype__, little_endian=little_endian))


def ros1(message: Any) -> bytes:
    return bytes(ROS1.serialize_ros1(message, message.__msgtype__))


def stores_of(kind: str) -> Any:
    """Returns the message types of a kind of bag."""
    return ROS1 if kind.startswith("ros1") else ROS2


def write_bag(directory: Path, kind: str, messages: Iterable[tuple[str, int, Any]]) -> Path:
    """Writes a bag.

    Args:
        kind: one of BAG_KINDS or PACKED_BAG_KINDS.
        messages: topic, time of recording in ns, and message of ``stores_of(kind)``.

    Returns:
        The path to open: a file, or the folder of a ROS 2 bag.
    """
    stores = stores_of(kind)
    path = directory / f"bag-{kind.replace(' ', '-')}"
    if stores is ROS1:
        path = path.with_suffix(".bag")
        writer: Any = Writer1(path)
        if " " in kind:
            writer.set_compression(Writer1.CompressionFormat[kind.split()[1].upper()])
    else:
        plugin = StoragePlugin.SQLITE3 if kind.startswith("sqlite3") else StoragePlugin.MCAP
        writer = Writer2(path, version=8, storage_plugin=plugin)
        if "zstd" in kind:
            mode = kind.split()[2].replace("chunk", "storage").upper()
            writer.set_compression(CompressionMode[mode], CompressionFormat.ZSTD)
    serialise = ros1 if stores is ROS1 else cdr
    connections: dict[str, Any] = {}
    with writer:
        if kind == "mcap lz4 chunk":  # as other recorders write it
            writer.storage.compression, writer.storage.compressor = "lz4", lz4.frame.compress
        for topic, time_ns, message in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, message.__msgtype__, typestore=stores)
            writer.write(connections[topic], time_ns, serialise(message))
    return path / f"{path.name}.mcap" if kind == "mcap file" else path

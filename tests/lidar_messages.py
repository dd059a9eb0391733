"""Messages of LiDARs' drivers as rosbags serialises them by their definitions, for our decoders.

The definitions are those of livox_ros_driver2 1.2.4, point_cloud_interfaces 4.0, common_interfaces (Humble,
Noetic), velodyne_msgs 2.3 and ouster_sensor_msgs 0.13.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from rosbags.typesys import get_types_from_msg

from firstfix.recording.messages import CDR, RawMessage
from firstfix.recording.messages import ROS1 as AS_ROS1
from tests.ros_samples import ROS1, ROS2, header

NS = 10**9
STAMP_NS = 1_730_000_000_250_000_001
CUSTOM_POINT = (
    "uint32 offset_time\nfloat32 x\nfloat32 y\nfloat32 z\nuint8 reflectivity\nuint8 tag\nuint8 line\n"
)
CUSTOM = (
    "std_msgs/Header header\nuint64 timebase\nuint32 point_num\nuint8 lidar_id\nuint8[3] rsvd\n"
    "CustomPoint[] points\n"
)
COMPRESSED = (
    "std_msgs/Header header\nuint32 height\nuint32 width\nsensor_msgs/PointField[] fields\n"
    "bool is_bigendian\n"
    "uint32 point_step\nuint32 row_step\nuint8[] compressed_data\nbool is_dense\nstring format\n"
)
LIVOX = ("livox_ros_driver", "livox_ros_driver2", "livox_interfaces")
OUSTER = ("ouster_ros", "ouster_sensor_msgs", "ouster_msgs")
COMPRESSED_CLOUD = "point_cloud_interfaces/msg/CompressedPointCloud2"
VELODYNE_SCAN = "velodyne_msgs/msg/VelodyneScan"
STORES = {CDR: ROS2, AS_ROS1: ROS1}
for _store in (ROS1, ROS2):
    for _package in LIVOX:
        _store.register(get_types_from_msg(CUSTOM_POINT, f"{_package}/msg/CustomPoint"))
        _store.register(get_types_from_msg(CUSTOM, f"{_package}/msg/CustomMsg"))
    for _package in OUSTER:
        _store.register(get_types_from_msg("uint8[] buf\n", f"{_package}/msg/PacketMsg"))
    _store.register(get_types_from_msg(COMPRESSED, COMPRESSED_CLOUD))
    _time = "time" if _store is ROS1 else "builtin_interfaces/Time"
    _store.register(
        get_types_from_msg(f"{_time} stamp\nuint8[1206] data\n", "velodyne_msgs/msg/VelodynePacket")
    )
    _store.register(get_types_from_msg("std_msgs/Header header\nVelodynePacket[] packets\n", VELODYNE_SCAN))


def raw(message: Any, encoding: str = CDR, topic: str = "/lidar", time_ns: int = STAMP_NS) -> RawMessage:
    """A message as a bag has it."""
    kind = message.__msgtype__
    store = STORES[encoding]
    body = store.serialize_ros1(message, kind) if encoding == AS_ROS1 else store.serialize_cdr(message, kind)
    return RawMessage(topic, time_ns, bytes(body), kind, encoding)


def livox(points: np.ndarray, package: str = "livox_ros_driver2", encoding: str = CDR) -> Any:
    """A CustomMsg of structured points: offset_time in ns, x, y, z, reflectivity, tag, line."""
    types = STORES[encoding].types
    point = types[f"{package}/msg/CustomPoint"]
    return types[f"{package}/msg/CustomMsg"](
        header=header(STORES[encoding], STAMP_NS, "livox_frame"),
        timebase=STAMP_NS,
        point_num=len(points),
        lidar_id=3,
        rsvd=np.zeros(3, np.uint8),
        points=[point(*one) for one in points.tolist()],
    )


def point_cloud1(xyz: np.ndarray, channels: dict[str, np.ndarray], encoding: str = CDR) -> Any:
    """A sensor_msgs/PointCloud."""
    types = STORES[encoding].types
    return types["sensor_msgs/msg/PointCloud"](
        header=header(STORES[encoding], STAMP_NS, "laser"),
        points=[types["geometry_msgs/msg/Point32"](*one) for one in xyz.tolist()],
        channels=[types["sensor_msgs/msg/ChannelFloat32"](name, values) for name, values in channels.items()],
    )


def compressed(cloud: Any, form: str, data: bytes, encoding: str = CDR, **replaced: Any) -> Any:
    """The CompressedPointCloud2 of a PointCloud2 whose data is packed."""
    values = {
        name: getattr(cloud, name)
        for name in (
            "header",
            "height",
            "width",
            "fields",
            "is_bigendian",
            "point_step",
            "row_step",
            "is_dense",
        )
    }
    packed = np.frombuffer(data, np.uint8)
    values |= {"compressed_data": packed, "format": form} | replaced
    return STORES[encoding].types[COMPRESSED_CLOUD](**values)


def velodyne_scan(packets: list[tuple[int, bytes]], encoding: str = CDR) -> Any:
    """A VelodyneScan of packets with their times in ns."""
    types = STORES[encoding].types
    return types[VELODYNE_SCAN](
        header=header(STORES[encoding], packets[-1][0] if packets else 0, "velodyne"),
        packets=[
            types["velodyne_msgs/msg/VelodynePacket"](
                types["builtin_interfaces/msg/Time"](*divmod(time_ns, NS)), np.frombuffer(data, np.uint8)
            )
            for time_ns, data in packets
        ],
    )


def ouster_packet(data: bytes, package: str = "ouster_sensor_msgs", encoding: str = CDR) -> Any:
    """A PacketMsg."""
    return STORES[encoding].types[f"{package}/msg/PacketMsg"](np.frombuffer(data, np.uint8))

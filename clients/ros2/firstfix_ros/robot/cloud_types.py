"""Types of messages that a gateway takes for clouds. Those of a topic are told by discovery."""

from __future__ import annotations

from firstfix.errors import UnsupportedFormat
from firstfix.formats.point_cloud import SCAN_LIMITS
from firstfix.ros import point_cloud2
from firstfix.ros.point_cloud2 import StampedCloud, decode_point_cloud2

COMPRESSED = "point_cloud_interfaces/msg/CompressedPointCloud2"
LIVOX = ("livox_ros_driver2/msg/CustomMsg", "livox_interfaces/msg/CustomMsg")
# In the order of choice: of a topic with several, those of an upper one are taken.
CLOUD_TYPES = (point_cloud2.TYPE, COMPRESSED, *LIVOX)
# What sends PointCloud2 in the place of a type.
_WITHOUT = {
    COMPRESSED: "ros2 run point_cloud_transport republish --ros-args -p in_transport:=zstd "
    "-p out_transport:=raw sends PointCloud2",
    **dict.fromkeys(LIVOX, "with xfer_format 0 its driver sends PointCloud2"),
}


def decode_cloud(ros_type: str, body: bytes) -> StampedCloud:
    """Decode a cloud of one of CLOUD_TYPES.

    Raises:
        MalformedData, TooLarge, UnsupportedFormat: as the decoder of the type says; or the robot's part of
            firstfix alone is installed, which decodes PointCloud2.
    """
    if ros_type == point_cloud2.TYPE:
        return decode_point_cloud2(body, SCAN_LIMITS)
    try:
        from firstfix.recording.live_clouds import decode_live_cloud
    except ModuleNotFoundError as error:  # the robot's distribution has no such module
        raise UnsupportedFormat(
            f"the robot's part of firstfix takes PointCloud2: install firstfix itself for {ros_type}, or: "
            f"{_WITHOUT[ros_type]}"
        ) from error
    try:
        return decode_live_cloud(ros_type, body, SCAN_LIMITS)
    except ModuleNotFoundError as error:  # of a format: DracoPy
        raise UnsupportedFormat(str(error)) from error


def missing_messages(ros_type: str) -> str:
    """Words for a topic whose messages this Python has no package of."""
    package = ros_type.partition("/")[0]
    return (
        f"its clouds are {ros_type}, and this Python has no {package}: source the workspace that has it, or: "
        f"{_WITHOUT.get(ros_type, 'publish PointCloud2')}"
    )

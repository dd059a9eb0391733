"""Decoder of Livox' CustomMsg, the default of livox_ros_driver, livox_ros_driver2 and livox_ros2_driver.

Their ``xfer_format`` 0 sends PointCloud2 instead. Layout: CustomMsg.msg and CustomPoint.msg of
livox_ros_driver2 1.2.4.
"""

from __future__ import annotations

import numpy as np

from ..formats.point_cloud import Limits, PointCloud
from ..ros.header import read_header
from ..ros.point_cloud2 import StampedCloud
from .messages import RawMessage
from .struct_reader import StructReader

TYPES = (
    "livox_ros_driver/msg/CustomMsg",
    "livox_ros_driver2/msg/CustomMsg",
    "livox_interfaces/msg/CustomMsg",
)
_POINT = np.dtype(
    [
        ("offset_time", "u4"),  # ns from the header's stamp, which is the first point's
        *((axis, "f4") for axis in "xyz"),
        *((name, "u1") for name in ("reflectivity", "tag", "line")),
    ]
)


def decode_livox(message: RawMessage, limits: Limits) -> StampedCloud:
    """Decode x, y, z (metres), reflectivity, the lasers' numbers and the points' times.

    A pixel without a return is a point at the origin: those are no returns for a scan either.

    Raises:
        MalformedData: cut off, or not such a message.
        TooLarge: over the limits.
    """
    reader = StructReader("CustomMsg", message.body, ros1=message.ros1)
    header = read_header(reader)
    reader.number("Q")  # timebase: the stamp, in ns
    reader.number("I")  # number of points, which stands before them again
    for _ in range(4):
        reader.number("B")  # of the LiDAR; reserved
    count = reader.number("I")
    limits.check("CustomMsg", count, _POINT.itemsize)
    points = reader.structs(_POINT, count)
    reader.end()
    return StampedCloud(
        header, PointCloud({name: points[name] for name in _POINT.names or () if name != "tag"})
    )

"""Decoder of sensor_msgs/PointCloud, which PointCloud2 replaced."""

from __future__ import annotations

import numpy as np

from ..formats.point_cloud import Limits, PointCloud
from ..ros.header import read_header
from ..ros.point_cloud2 import StampedCloud
from .messages import RawMessage
from .struct_reader import StructReader

TYPE = "sensor_msgs/msg/PointCloud"
_MAX_CHANNELS = 64
_POINT, _VALUE = np.dtype([(axis, "f4") for axis in "xyz"]), np.dtype("f4")


def decode_point_cloud1(message: RawMessage, limits: Limits) -> StampedCloud:
    """Decode x, y, z and the channels, all of them float32: a channel of times can only be in seconds.

    Raises:
        MalformedData: cut off, not such a message, or a channel has not one value for each point.
        TooLarge: over the limits.
    """
    reader = StructReader("PointCloud", message.body, ros1=message.ros1)
    header = read_header(reader)
    count = reader.number("I")
    limits.check("PointCloud", count, _POINT.itemsize)
    points = reader.structs(_POINT, count)
    columns = {axis: points[axis] for axis in "xyz"}
    channels = reader.count(_MAX_CHANNELS, "channels")
    limits.check("PointCloud", count, _POINT.itemsize + _VALUE.itemsize * channels)
    for _ in range(channels):
        name = reader.text()
        values = reader.number("I")
        if values != count:
            reader.fail(f"the channel {name!r} has {values} values for {count} points")
        columns.setdefault(name, reader.structs(_VALUE, count))
    reader.end()
    return StampedCloud(header, PointCloud(columns))

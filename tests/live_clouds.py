"""Messages of the types that a gateway takes for clouds, as rosbags serialises them."""

from __future__ import annotations

import zlib

import numpy as np
import zstandard

from firstfix.ros import point_cloud2
from tests.lidar_messages import COMPRESSED_CLOUD, compressed, livox, raw
from tests.ros_samples import cdr, cloud_of_points

LIVOX_TYPE = "livox_ros_driver2/msg/CustomMsg"
_POINT = [
    ("offset_time", "u4"),
    *((axis, "f4") for axis in "xyz"),
    *((name, "u1") for name in ("reflectivity", "tag", "line")),
]


def live_cloud(form: str, points: np.ndarray, stamp_ns: int, frame_id: str) -> bytes:
    """A cloud of (n, 3) points in CDR: ``plain``, ``zstd``, ``zlib`` or ``livox``."""
    if form == "livox":
        rows = np.zeros(len(points), _POINT)
        for number, axis in enumerate("xyz"):
            rows[axis] = points[:, number]
        message = livox(rows)
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 10**9)
        message.header.frame_id = frame_id
        return bytes(raw(message).body)
    cloud = cloud_of_points(points, stamp_ns=stamp_ns, frame_id=frame_id)
    if form == "plain":
        return bytes(cdr(cloud))
    data = np.asarray(cloud.data, np.uint8).tobytes()
    packed = zstandard.compress(data) if form == "zstd" else zlib.compress(data)
    return bytes(raw(compressed(cloud, form, packed)).body)


TYPE_OF = {
    "plain": point_cloud2.TYPE,
    "zstd": COMPRESSED_CLOUD,
    "zlib": COMPRESSED_CLOUD,
    "livox": LIVOX_TYPE,
}

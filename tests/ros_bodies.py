"""A PointCloud2 as ROS 2 writes it: by rosbags, not by our own code, which reads it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_typestore

_STORES = get_typestore(Stores.ROS2_HUMBLE)
_FLOAT32 = 7


def point_cloud2(xyz: NDArray[np.float32]) -> bytes:
    """The CDR bytes of points (n, 3) in metres."""
    types = _STORES.types
    time = types["builtin_interfaces/msg/Time"](1_700_000_000, 250_000_000)
    message = types["sensor_msgs/msg/PointCloud2"](
        header=types["std_msgs/msg/Header"](stamp=time, frame_id="os_sensor"),
        height=1,
        width=len(xyz),
        fields=[
            types["sensor_msgs/msg/PointField"](axis, 4 * i, _FLOAT32, 1) for i, axis in enumerate("xyz")
        ],
        is_bigendian=False,
        point_step=12,
        row_step=12 * len(xyz),
        data=np.frombuffer(xyz.astype("<f4").tobytes(), np.uint8),
        is_dense=True,
    )
    return bytes(_STORES.serialize_cdr(message, message.__msgtype__))

"""Names of messages."""

from __future__ import annotations

import numpy as np
import pytest

from firstfix.decode import decode_query
from firstfix.errors import UnsupportedFormat
from firstfix.ros.media_types import POINT_CLOUD2
from tests.every_case import every_case
from tests.ros_samples import cdr, cloud_of_points


@every_case(
    "media_type",
    [
        POINT_CLOUD2,
        "application/vnd.ros2.cdr; type=sensor_msgs/msg/PointCloud2",
        "Application/Vnd.ROS2.cdr;Type=sensor_msgs/msg/PointCloud2",
        "application/vnd.ros2.cdr",
        "application/cdr",
        "application/cdr;sensor_msgs/msg/PointCloud2",
    ],
)
def test_a_cloud_by_any_of_its_names(media_type):
    points = np.arange(30, dtype=np.float32).reshape(10, 3)
    np.testing.assert_array_equal(decode_query(cdr(cloud_of_points(points)), media_type).points, points)


@every_case(
    "media_type",
    ["application/vnd.ros2.cdr; type=sensor_msgs/msg/Imu", "application/cdr;std_msgs/msg/String"],
)
def test_another_message_is_refused_by_name(media_type):
    with pytest.raises(UnsupportedFormat, match=r"a scan cannot be read from a (sensor|std)_msgs/msg/"):
        decode_query(cdr(cloud_of_points(np.ones((3, 3)))), media_type)

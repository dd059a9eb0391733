"""Names of messages, and the choice of the pose message."""

from __future__ import annotations

import numpy as np
import pytest

from every_case import every_case
from firstfix.decode import decode_query
from firstfix.errors import UnsupportedFormat
from firstfix.ros.media_types import POINT_CLOUD2, POSE, wants_pose
from ros_samples import cdr, cloud_of_points


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


@every_case(
    "accept",
    [
        POSE,
        "application/vnd.ros2.cdr",
        "application/vnd.ros2.cdr; type=geometry_msgs/msg/PoseWithCovarianceStamped",
        "application/cdr;geometry_msgs/msg/PoseWithCovarianceStamped",
        f"text/html, {POSE}, */*;q=0.1",
        f"{POSE}, application/json;q=0.5",
        f"{POSE}, application/json",
    ],
)
def test_the_pose_message_is_wanted(accept):
    assert wants_pose(accept)


@every_case(
    "accept",
    [
        "",
        "*/*",
        "application/json",
        "application/*",
        "application/geopose+json",
        "application/vnd.ros2.cdr; type=geometry_msgs/msg/PoseStamped",
        f"{POSE};q=0",
        f"{POSE};q=0.4, application/json;q=0.5",
        f"{POSE};q=nan",
        f"{POSE};q=much",
        ";;,,=;q",
    ],
)
def test_it_is_not(accept):
    assert not wants_pose(accept)

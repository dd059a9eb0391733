"""sensor_msgs/PointCloud, the message before PointCloud2."""

from __future__ import annotations

import numpy as np
import pytest

from firstfix.errors import InputError, MalformedData, TooLarge
from firstfix.formats.point_cloud import SCAN_LIMITS, Limits
from firstfix.recording.messages import CDR, ROS1, RawMessage
from firstfix.recording.point_cloud1 import decode_point_cloud1
from tests.every_case import every_case
from tests.lidar_messages import STAMP_NS, point_cloud1, raw

XYZ = np.random.default_rng(1).uniform(-9, 9, (77, 3)).astype(np.float32)
CHANNELS = {"intensity": np.arange(77, dtype=np.float32), "time": np.linspace(0, 0.09, 77, dtype=np.float32)}


@every_case("encoding", [CDR, ROS1])
def test_points_and_channels_are_read(encoding: str):
    stamped = decode_point_cloud1(raw(point_cloud1(XYZ, CHANNELS, encoding), encoding), SCAN_LIMITS)
    assert (stamped.header.stamp.ns, stamped.header.frame_id) == (STAMP_NS, "laser")
    scan = stamped.scan()
    np.testing.assert_array_equal(scan.points, XYZ)
    np.testing.assert_array_equal(scan.intensity, CHANNELS["intensity"])
    np.testing.assert_allclose(scan.time_s, CHANNELS["time"])


def test_sizes_that_contradict_each_other_are_refused():
    with pytest.raises(MalformedData, match="'intensity' has 5 values for 77 points"):
        decode_point_cloud1(raw(point_cloud1(XYZ, {"intensity": CHANNELS["time"][:5]})), SCAN_LIMITS)
    with pytest.raises(TooLarge):
        decode_point_cloud1(raw(point_cloud1(XYZ, {})), Limits(50, 10**6))
    good = raw(point_cloud1(XYZ, CHANNELS))
    for size in range(0, len(good.body), 7):
        with pytest.raises(InputError):
            decode_point_cloud1(RawMessage("/p", 0, good.body[:size], good.type, CDR), SCAN_LIMITS)

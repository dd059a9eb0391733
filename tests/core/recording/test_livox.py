"""Livox' CustomMsg, of its three drivers, in bags of ROS 1 and 2."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from firstfix.errors import InputError, MalformedData, TooLarge
from firstfix.formats.point_cloud import SCAN_LIMITS, Limits
from firstfix.recording.livox import TYPES, decode_livox
from firstfix.recording.messages import CDR, ROS1, RawMessage
from firstfix.recording.recording import open_recording
from tests import ros_samples
from tests.every_case import every_case
from tests.lidar_messages import LIVOX, STAMP_NS, livox, raw
from tests.ros_samples import write_bag

COUNT = 96  # per line, as in one packet of an Avia
POINTS = np.zeros(
    COUNT,
    [("t", "u4"), *((axis, "f4") for axis in "xyz"), ("reflectivity", "u1"), ("tag", "u1"), ("line", "u1")],
)
POINTS["t"] = np.linspace(0, 99_900_000, COUNT)
POINTS["reflectivity"], POINTS["tag"], POINTS["line"] = np.arange(COUNT), 16, np.arange(COUNT) % 6
for _axis in "xyz":
    POINTS[_axis] = np.random.default_rng(ord(_axis)).uniform(-40, 40, COUNT)
DRIVERS = [(package, encoding) for package in LIVOX for encoding in (CDR, ROS1)]


@every_case("package, encoding", DRIVERS)
def test_points_and_times_are_those_of_the_driver(package: str, encoding: str):
    message = raw(livox(POINTS, package, encoding), encoding)
    assert message.type in TYPES
    assert encoding == CDR or len(message.body) == 4 + 8 + 4 + len("livox_frame") + 8 + 4 + 4 + 4 + 19 * COUNT
    stamped = decode_livox(message, SCAN_LIMITS)
    assert (stamped.header.stamp.ns, stamped.header.frame_id) == (STAMP_NS, "livox_frame")
    scan = stamped.scan()
    np.testing.assert_array_equal(scan.points, np.stack([POINTS[axis] for axis in "xyz"], axis=1))
    np.testing.assert_allclose(scan.time_s, POINTS["t"] * 1e-9, atol=1e-8)
    np.testing.assert_array_equal(scan.intensity, POINTS["reflectivity"])


def test_a_message_without_points_is_an_empty_cloud():
    for encoding in (CDR, ROS1):
        assert len(decode_livox(raw(livox(POINTS[:0], encoding=encoding), encoding), SCAN_LIMITS).cloud) == 0


def test_limits_are_checked_before_the_points():
    message = raw(livox(POINTS))
    with pytest.raises(TooLarge, match="96 points, the limit is 50"):
        decode_livox(message, Limits(50, 10**6))
    place = len(message.body) - 20 * COUNT + 1 - 4
    assert message.body[place : place + 4] == COUNT.to_bytes(4, "little")
    many = message.body[:place] + b"\xff\xff\x0f\x00" + message.body[place + 4 :]
    with pytest.raises(MalformedData, match="cut off"):
        decode_livox(RawMessage("/l", 0, many, message.type, CDR), SCAN_LIMITS)


@every_case("encoding", [CDR, ROS1])
def test_a_damaged_message_is_an_input_error(encoding: str):
    good, rng = raw(livox(POINTS, encoding=encoding), encoding), np.random.default_rng(2)
    for size in (*range(60), len(good.body) - 1, len(good.body) + 9):
        with pytest.raises(InputError):
            decode_livox(RawMessage("/l", 0, (good.body + bytes(9))[:size], good.type, encoding), SCAN_LIMITS)
    for _ in range(200):
        damaged = bytearray(good.body)
        damaged[rng.integers(0, 60)] ^= rng.integers(1, 256)
        with suppress(InputError):
            decode_livox(RawMessage("/l", 0, bytes(damaged), good.type, encoding), SCAN_LIMITS).scan()


@pytest.mark.parametrize("kind", ["ros1 lz4", "sqlite3", "mcap zstd chunk"])
def test_a_bag_of_that_driver_is_replayed(tmp_path: Path, kind: str):
    encoding = ROS1 if kind.startswith("ros1") else CDR
    driver = "livox_ros_driver" if encoding == ROS1 else "livox_ros_driver2"
    clouds = [("/livox/lidar", STAMP_NS + n, livox(POINTS, driver, encoding)) for n in range(3)]
    imu = ros_samples.imu([0, 0, 1.0], stores=ros_samples.stores_of(kind))
    with open_recording(write_bag(tmp_path, kind, [("/livox/imu", STAMP_NS - 1, imu), *clouds])) as recording:
        topic = recording.cloud_topic(None)
        assert (topic.name, topic.count) == ("/livox/lidar", 3)
        assert [len(recorded.cloud().scan()) for recorded in recording.clouds(topic)] == [COUNT] * 3

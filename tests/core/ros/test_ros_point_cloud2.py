"""PointCloud2: every layout that drivers send, against rosbags' serialiser."""

from __future__ import annotations

import struct
from contextlib import suppress

import numpy as np
import pytest

from firstfix.decode import decode_query
from firstfix.errors import InputError, MalformedData, TooLarge, UnsupportedFormat
from firstfix.formats.point_cloud import SCAN_LIMITS, Limits
from firstfix.ros.header import Stamp
from firstfix.ros.media_types import POINT_CLOUD2
from firstfix.ros.point_cloud2 import decode_point_cloud2
from tests import ros_samples
from tests.core.fixtures import in_memory_of
from tests.every_case import every_case
from tests.ros_samples import ROS1, cdr, cloud, cloud_of_points

OUSTER = [*((name, "f4") for name in ("x", "y", "z", "_", "intensity")), ("t", "u4"), ("ring", "u1")]
LAYOUTS = {
    "xyz": {"names": ["x", "y", "z"], "formats": ["f4"] * 3},
    "any order": {"names": ["z", "intensity", "x", "y"], "formats": ["f4", "u2", "f4", "f4"]},
    "float64": {"names": ["x", "y", "z"], "formats": ["f8"] * 3},
    "mixed floats": {"names": ["x", "y", "z"], "formats": ["f4", "f8", "f4"]},
    "with gaps": {
        "names": ["x", "y", "z", "intensity", "ring"],
        "formats": ["f4", "f4", "f4", "f4", "u2"],
        "offsets": [0, 4, 8, 16, 20],
        "itemsize": 32,
    },
    "reflectivity": {"names": ["x", "y", "z", "reflectivity"], "formats": ["f4", "f4", "f4", "u1"]},
}


def records(layout: object, shape: tuple[int, ...] = (50,), order: str = "<") -> np.ndarray:
    made = np.zeros(shape, np.dtype(layout).newbyteorder(order))
    rng = np.random.default_rng(3)
    for name in made.dtype.names:
        made[name] = rng.uniform(0, 100, shape)
    return made


def xyz_of(rows: np.ndarray) -> np.ndarray:
    flat = rows.reshape(-1)
    return np.stack([flat[axis].astype(np.float64) for axis in "xyz"], axis=1)


@every_case("little_endian", [True, False], ids=["CDR LE", "CDR BE"])
@every_case("order", ["<", ">"], ids=["points LE", "points BE"])
@every_case("layout", LAYOUTS)
def test_every_layout_in_both_byte_orders(layout, order, little_endian):
    rows = records(LAYOUTS[layout], order=order)
    stamped = decode_point_cloud2(cdr(cloud(rows), little_endian=little_endian), SCAN_LIMITS)
    np.testing.assert_array_equal(stamped.cloud.xyz, xyz_of(rows))
    assert stamped.header.stamp == Stamp(1_700_000_000, 250_000_001)
    assert stamped.header.frame_id == "os_sensor"
    name = next((name for name in ("intensity", "reflectivity") if name in rows.dtype.names), None)
    if name is None:
        assert stamped.cloud.intensity is None
    else:
        np.testing.assert_array_equal(stamped.cloud.intensity, rows[name])


@every_case("padding", [0, 13])
def test_an_organised_cloud_with_padded_rows(padding):
    rows = records(OUSTER, (16, 32))
    stamped = decode_point_cloud2(cdr(cloud(rows, row_padding=padding)), SCAN_LIMITS)
    np.testing.assert_array_equal(stamped.cloud.xyz, xyz_of(rows))
    np.testing.assert_array_equal(stamped.cloud.intensity, rows["intensity"].ravel())


def test_a_ros1_cloud_is_read():
    rows = records(OUSTER)
    body = ros_samples.ros1(cloud(rows, stores=ROS1))
    stamped = decode_point_cloud2(body, SCAN_LIMITS, ros1=True)
    np.testing.assert_array_equal(stamped.cloud.xyz, xyz_of(rows))
    assert (str(stamped.header.stamp), stamped.header.frame_id) == ("1700000000.250000001", "os_sensor")


@every_case("is_dense", [True, False])
def test_invalid_returns_are_dropped_even_from_dense_clouds(is_dense):
    rows = records(LAYOUTS["with gaps"])
    rows["y"][:7], rows["z"][7] = np.nan, np.inf
    scan = decode_point_cloud2(cdr(cloud(rows, is_dense=is_dense)), SCAN_LIMITS).scan()
    np.testing.assert_array_equal(scan.points, xyz_of(rows)[8:].astype(np.float32))
    np.testing.assert_array_equal(scan.intensity, rows["intensity"][8:])
    assert scan.stamp_s == pytest.approx(1_700_000_000.25, abs=1e-6)


def test_a_stamp_of_zero_is_none():
    unstamped = cdr(cloud_of_points(np.ones((1, 3)), stamp_ns=0))
    assert decode_point_cloud2(unstamped, SCAN_LIMITS).scan().stamp_s is None


@every_case("shape", [(0,), (4, 0)])
def test_an_empty_cloud_is_read(shape):
    assert len(decode_point_cloud2(cdr(cloud(records(OUSTER, shape))), SCAN_LIMITS).cloud) == 0


def field(name: str, offset: int, datatype: int = 7, count: int = 1) -> object:
    return ros_samples.ROS2.types["sensor_msgs/msg/PointField"](name, offset, datatype, count)


XYZ = [field("x", 0), field("y", 4), field("z", 8)]
EMPTY = np.zeros(0, np.uint8)
BAD = {
    "no z": ({"fields": XYZ[:2]}, MalformedData, "no field z"),
    "z of two numbers": ({"fields": [*XYZ[:2], field("z", 8, count=2)]}, MalformedData, "no field z"),
    "z is an integer": ({"fields": [*XYZ[:2], field("z", 8, 5)]}, UnsupportedFormat, "z is not FLOAT32"),
    "z behind the point": ({"fields": [*XYZ[:2], field("z", 9)]}, MalformedData, "'z' is outside"),
    "z far behind": ({"fields": [*XYZ[:2], field("z", 2**32 - 1)]}, MalformedData, "'z' is outside"),
    "intensity behind": ({"fields": [*XYZ, field("i", 12)]}, MalformedData, "'i' is outside"),
    "rows too short": ({"row_step": 599}, MalformedData, "contradict"),
    "fewer bytes than rows": ({"data": np.zeros(599, np.uint8)}, MalformedData, "contradict"),
    "more bytes than rows": ({"data": np.zeros(601, np.uint8)}, MalformedData, "contradict"),
    "more rows": ({"height": 2}, MalformedData, "contradict"),
    "more points": ({"width": 51}, MalformedData, "contradict"),
    "points without bytes": ({"point_step": 0}, MalformedData, "is outside"),
    "huge points": ({"point_step": 70_000, "width": 0, "height": 0, "data": EMPTY}, MalformedData, "70000"),
    "millions of points": ({"width": 2**32 - 1, "height": 2**32 - 1}, TooLarge, "the limit"),
    "gigabytes of points": ({"point_step": 2**32 - 1}, TooLarge, "the limit"),
    "too many fields": ({"fields": XYZ * 100}, MalformedData, "300 fields"),
    "a name without end": ({"fields": [field("n" * 2000, 0), *XYZ]}, MalformedData, "a text of 2001 bytes"),
}  # fmt: skip


@every_case("case", BAD)
def test_contradictory_sizes_are_refused(case):
    replaced, error, says = BAD[case]
    body = cdr(cloud_of_points(np.ones((50, 3)), **replaced))
    with pytest.raises(error, match=says):
        decode_point_cloud2(body, SCAN_LIMITS)


@every_case(("sec", "nanosec"), [(-1, 0), (0, 10**9)])
def test_an_invalid_stamp_is_malformed(sec, nanosec):
    body = bytearray(cdr(cloud_of_points(np.ones((2, 3)))))
    body[4:12] = struct.pack("<iI", sec, nanosec)
    with pytest.raises(MalformedData, match="stamp"):
        decode_point_cloud2(bytes(body), SCAN_LIMITS)


def test_invalid_limits_of_nets_are_refused():
    body = cdr(cloud_of_points(np.ones((50, 3))))
    with pytest.raises(TooLarge):
        decode_point_cloud2(body, Limits(max_points=49, max_decoded_bytes=10**9))
    with pytest.raises(TooLarge):
        decode_point_cloud2(body, Limits(max_points=10**9, max_decoded_bytes=599))


def test_a_promise_of_many_points_takes_no_memory():
    good = cdr(cloud_of_points(np.ones((50, 3))))
    with in_memory_of(1_000_000):
        for place in range(4, len(good) - 600, 1):
            damaged = bytearray(good)
            damaged[place : place + 4] = b"\xff\xff\xff\x7f"
            with suppress(InputError):
                decode_point_cloud2(bytes(damaged), SCAN_LIMITS)


def test_the_columns_are_views():
    body = cdr(cloud(records(OUSTER, (100_000,))))
    with in_memory_of(len(body) // 10):
        decode_point_cloud2(body, SCAN_LIMITS)


def test_the_times_of_the_points_are_those_of_the_scan():
    made = records(OUSTER)
    made["t"] = np.linspace(0, 1e8, 50)
    scan = decode_point_cloud2(cdr(cloud(made)), SCAN_LIMITS).scan()
    np.testing.assert_allclose(scan.time_s, np.linspace(0, 0.1, 50), atol=1e-6)
    assert scan.stamp_s == pytest.approx(1_700_000_000.25)
    of_epoch = records([("x", "f4"), ("y", "f4"), ("z", "f4"), ("timestamp", "f8")], order=">")
    of_epoch["timestamp"] = 1_700_000_000.25 + np.linspace(-0.1, 0, 50)
    scan = decode_point_cloud2(cdr(cloud(of_epoch)), SCAN_LIMITS).scan()
    np.testing.assert_allclose(scan.time_s, np.linspace(-0.1, 0, 50), atol=1e-6)
    made["t"] = 0
    assert decode_point_cloud2(cdr(cloud(made)), SCAN_LIMITS).scan().time_s is None


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
def test_another_message_is_unsupported(media_type):
    with pytest.raises(UnsupportedFormat, match=r"a scan cannot be read from a (sensor|std)_msgs/msg/"):
        decode_query(cdr(cloud_of_points(np.ones((3, 3)))), media_type)

"""Bags of every kind, made by rosbags."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from firstfix.errors import InputError, InvalidOption, MalformedData, NotFound, TooLarge, UnsupportedFormat
from firstfix.formats.point_cloud import SCAN_LIMITS
from firstfix.recording.recording import open_recording
from firstfix.ros.point_cloud2 import decode_point_cloud2
from tests import ros_samples
from tests.core.fixtures import in_memory_of
from tests.ros_samples import BAG_KINDS, IMU, PACKED_BAG_KINDS, cloud_of_points, stores_of, write_bag

S = 10**9
POINTS = [np.full((10 + number, 3), float(number)) for number in range(5)]
every_kind = pytest.mark.parametrize("kind", [*BAG_KINDS, *PACKED_BAG_KINDS])


def clouds(kind: str, topic: str = "/points") -> list[tuple[str, int, object]]:
    stores = stores_of(kind)
    return [
        (topic, (100 + number) * S, cloud_of_points(points, stores=stores, stamp_ns=(99 + number) * S))
        for number, points in enumerate(POINTS)
    ]


@every_kind
def test_clouds_come_in_order_and_whole(tmp_path: Path, kind: str):
    path = write_bag(tmp_path, kind, clouds(kind))
    with open_recording(path) as bag:
        assert bag.cloud_topic(None) == bag.cloud_topic("/points")
        assert bag.cloud_topic(None).name == "/points"
        assert bag.cloud_topic(None).count == 5
        assert bag.start_ns == 100 * S
        read = list(bag.messages(["/points"]))
        assert [message.time_ns for message in read] == [(100 + number) * S for number in range(5)]
        for message, points in zip(read, POINTS, strict=True):
            stamped = decode_point_cloud2(message.body, SCAN_LIMITS, ros1=message.ros1)
            np.testing.assert_array_equal(stamped.cloud.xyz, points)
            assert stamped.header.stamp.ns == message.time_ns - S
        assert [m.time_ns // S for m in bag.messages(["/points"], 103 * S)] == [103, 104]
        assert list(bag.messages(["/other"])) == list(bag.messages([])) == []


@every_kind
def test_topics_are_found_by_type(tmp_path: Path, kind: str):
    imu = ros_samples.imu([0, 0, 9.81], stores=stores_of(kind))
    path = write_bag(tmp_path, kind, [("/imu", 99 * S, imu), *clouds(kind, "/b"), *clouds(kind, "/a")])
    with open_recording(path) as bag:
        assert bag.topics_of(IMU) == ["/imu"]
        with pytest.raises(InvalidOption, match="choose one: /a, /b"):
            bag.cloud_topic(None)
        with pytest.raises(NotFound, match="topics that have: /a, /b"):
            bag.cloud_topic("/imu")
        with pytest.raises(NotFound, match="topics that have: /imu"):
            bag.check_topic("/a", IMU)


def test_a_bag_without_clouds_is_refused(tmp_path: Path):
    path = write_bag(tmp_path, "sqlite3", [("/imu", S, ros_samples.imu([0, 0, 9.81]))])
    said = "no topic has clouds; its messages are sensor_msgs/msg/Imu"
    with open_recording(path) as bag, pytest.raises(NotFound, match=said):
        bag.cloud_topic(None)


def test_other_files_are_no_bags(tmp_path: Path):
    (tmp_path / "scan.pcd").write_bytes(b"x")
    (tmp_path / "folder").mkdir()
    for name in ("a.bag", "a.mcap", "a.db3"):
        (tmp_path / name).write_bytes(b"")
        (tmp_path / f"b{name}").write_bytes(b"nonsense" * 100)
    for name, error in {
        "absent.bag": NotFound,
        "scan.pcd": UnsupportedFormat,
        "folder": MalformedData,
        **{f"{prefix}a.{end}": MalformedData for prefix in ("", "b") for end in ("bag", "mcap", "db3")},
    }.items():
        with pytest.raises(error, match=name), open_recording(tmp_path / name):
            pass


@every_kind
def test_a_damaged_bag_is_an_input_error(tmp_path: Path, kind: str):
    path = write_bag(tmp_path, kind, clouds(kind))
    file = (
        path if path.is_file() else next(p for p in path.iterdir() if p.suffix in (".db3", ".mcap", ".zstd"))
    )
    good, rng = file.read_bytes(), np.random.default_rng(8)
    refused = 0
    for trial in range(60):
        damaged = bytearray(good)
        if trial % 2:
            damaged = damaged[: rng.integers(len(good))]
        else:
            for place in rng.integers(0, len(good), 40):
                damaged[place] ^= rng.integers(1, 256)
        file.write_bytes(damaged)
        try:
            with open_recording(path) as bag:
                for _ in bag.messages(bag.topics_of("sensor_msgs/msg/PointCloud2")):
                    pass
        except (MalformedData, TooLarge, UnsupportedFormat):
            refused += 1
    assert refused > 10


def test_a_damaged_index_is_named_even_where_its_library_names_nothing(tmp_path: Path):
    """The library has assertions without a text."""
    path = write_bag(tmp_path, "ros1", clouds("ros1"))
    good, said = path.read_bytes(), set[str]()
    for place in range(len(good) - 1_200, len(good)):
        damaged = bytearray(good)
        damaged[place] ^= 0x55
        path.write_bytes(damaged)
        try:
            with open_recording(path) as bag:
                bag.cloud_topic(None)
        except (InputError, NotFound) as error:
            said.add(str(error).removeprefix(f"{path}: "))
    assert "the recording cannot be read: AssertionError" in said
    assert not [text for text in said if text.endswith(": ")]


@every_kind
def test_one_message_is_in_memory_at_a_time(tmp_path: Path, kind: str):
    stores, rng = stores_of(kind), np.random.default_rng(1)
    clouds = (cloud_of_points(rng.normal(size=(50_000, 3)), stores=stores) for _ in range(20))  # 600 kB each
    made = (("/points", n * S, cloud) for n, cloud in enumerate(clouds, start=1))
    path = write_bag(tmp_path, kind, made)
    with open_recording(path):
        pass  # what is imported then is not counted
    with in_memory_of(8_000_000), open_recording(path) as bag:  # 20 are 12 MB; a chunk of a bag holds a few
        assert sum(1 for _ in bag.messages(["/points"])) == 20


def test_an_invalid_serialization_is_an_input_error(tmp_path: Path):
    """Damaged bags have such, beside others; they were a TypeError."""
    path = write_bag(tmp_path, "sqlite3", [*clouds("sqlite3"), *clouds("sqlite3", "/b")])
    (file,) = path.glob("*.db3")
    with closing(sqlite3.connect(file)) as opened, opened:
        opened.execute("UPDATE topics SET serialization_format = x'ff' WHERE name = '/b'")
        opened.execute("UPDATE topics SET serialization_format = 'cbor' WHERE name = '/points'")
    with pytest.raises(InputError), open_recording(file):
        pass
    with closing(sqlite3.connect(file)) as opened, opened:
        opened.execute("UPDATE topics SET serialization_format = 'cdr' WHERE name = '/b'")
    with open_recording(file) as bag:  # only the asked topic matters
        assert bag.cloud_topic(None).name == "/b"
        with pytest.raises(NotFound, match="cbor is not read"):
            bag.cloud_topic("/points")

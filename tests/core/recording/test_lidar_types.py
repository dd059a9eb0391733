"""Bags without clouds that are read: what they say of their topics."""

from __future__ import annotations

from pathlib import Path

import pytest

from firstfix.errors import MalformedData, NotFound
from firstfix.recording.recording import open_recording
from tests import ros_samples
from tests.every_case import every_case
from tests.mcap_files import write_mcap
from tests.ros_samples import write_bag

SAID = {
    "hesai_ros_driver/msg/UdpFrame": "play the bag through the maker's driver",
    "pandar_msgs/msg/PandarScan": "nebula reads them too",
    "nebula_msgs/msg/NebulaPackets": "play the bag through nebula",
    "rslidar_msg/msg/RslidarPacket": "play the bag through the maker's driver",
    "livox_ros_driver2/msg/LivoxPacket": "xfer_format 0",
    "foxglove_msgs/msg/PointCloud": "record foxglove.PointCloud in protobuf",
    "sensor_msgs/msg/LaserScan": "a plane of points",
}


@every_case("kind", SAID)
def test_a_lidar_that_is_not_read_says_what_makes_clouds_of_it(
    tmp_path_factory: pytest.TempPathFactory, kind: str
):
    others = [("/imu", "sensor_msgs/msg/Imu", "cdr", b"", 5, b"")]
    path = write_mcap(
        tmp_path_factory.mktemp("bag") / "a.mcap", [("/lidar", kind, "cdr", b"", 5, b""), *others]
    )
    with open_recording(path) as recording:
        for wanted in (None, "/lidar"):
            with pytest.raises(NotFound) as raised:
                recording.cloud_topic(wanted)
            assert f"/lidar has {kind}: " in str(raised.value)
            assert SAID[kind] in str(raised.value)
            assert "/imu" not in str(raised.value)


def test_a_bag_without_a_lidar_says_what_is_in_it(tmp_path: Path):
    messages = [("/a", "b.C", "protobuf", b"", 5, b""), ("/d", "sensor_msgs/msg/Imu", "cdr", b"", 5, b"")]
    with open_recording(write_mcap(tmp_path / "a.mcap", messages)) as recording:
        with pytest.raises(
            NotFound, match=r"no topic has clouds; its messages are b\.C, sensor_msgs/msg/Imu$"
        ):
            recording.cloud_topic(None)
        with pytest.raises(
            NotFound, match="/d has no clouds but sensor_msgs/msg/Imu; topics that have: none"
        ):
            recording.cloud_topic("/d")
    empty = write_mcap(tmp_path / "b.mcap", [])
    with open_recording(empty) as recording, pytest.raises(NotFound, match="it has no messages"):
        recording.cloud_topic(None)


def test_ros1_bags_without_an_index_name_the_command(tmp_path: Path):
    stores = ros_samples.stores_of("ros1")
    path = write_bag(tmp_path, "ros1", [("/imu", 5, ros_samples.imu([0, 0, 1], stores=stores))])
    data = path.read_bytes()
    place = data.index(b"index_pos=") + len(b"index_pos=")
    path.write_bytes(data[:place] + bytes(8) + data[place + 8 :])
    with pytest.raises(MalformedData, match=rf"`rosbag reindex {path.name}`"), open_recording(path):
        pass
    active = path.rename(path.with_name("drive.bag.active"))
    with (
        pytest.raises(
            MalformedData, match=r"`rosbag reindex drive\.bag\.active`.* name the file drive\.bag$"
        ),
        open_recording(active),
    ):
        pass

"""Velodyne's packets in bags and captures, held against the walls that they show and against the library."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import velodyne_decoder

from firstfix.errors import InputError, MalformedData, TooLarge, UnsupportedFormat
from firstfix.formats.point_cloud import SCAN_LIMITS, Limits
from firstfix.recording.messages import CDR, ROS1, RawMessage
from firstfix.recording.recording import open_recording
from firstfix.recording.velodyne import velodyne_decoder as decoder_of_scans
from tests.captures import PACKET_S, vlp16_packets, wall_distance_m, write_pcap
from tests.every_case import every_case
from tests.lidar_messages import raw, velodyne_scan
from tests.ros_samples import write_bag

START_NS = 1_730_000_000 * 10**9
PACKETS = vlp16_packets(turns=1.0)


@every_case("encoding", [CDR, ROS1])
def test_a_scan_message_gives_the_walls_and_the_times(encoding: str):
    stamped = decoder_of_scans()(raw(velodyne_scan(PACKETS, encoding), encoding), SCAN_LIMITS)
    assert stamped.header.frame_id == "velodyne"
    assert stamped.header.stamp.ns == PACKETS[-1][0]
    scan = stamped.scan()
    assert len(scan) == len(PACKETS) * 12 * 32
    assert wall_distance_m(scan.points).max() < 0.05
    # Times count from the last packet: the first point was one turn before.
    assert scan.time_s is not None
    assert scan.time_s.min() == pytest.approx(-(len(PACKETS) - 1) * PACKET_S, abs=1e-4)
    assert 0 < scan.time_s.max() < PACKET_S
    azimuth = np.arctan2(-scan.points[:, 1], scan.points[:, 0]) % (2 * np.pi)  # clockwise from the front
    rest = np.abs(azimuth / (2 * np.pi) - (scan.time_s - scan.time_s.min()) / (len(PACKETS) * PACKET_S))
    assert np.median(rest) < 0.005
    assert set(np.unique(stamped.cloud.ring).tolist()) == set(range(16))


def test_a_bag_of_the_driver_is_read(tmp_path: Path):
    scans = [
        ("/velodyne_packets", START_NS + n * 10**8, velodyne_scan(vlp16_packets(1.0, START_NS + n * 10**8)))
        for n in range(2)
    ]
    with open_recording(write_bag(tmp_path, "mcap", scans)) as recording:
        topic = recording.cloud_topic(None)
        assert topic.name == "/velodyne_packets"
        assert [len(recorded.cloud().scan()) for recorded in recording.clouds(topic)] == [
            len(PACKETS) * 384
        ] * 2


@every_case("order", ["<", ">"])
def test_a_capture_gives_what_the_library_gives(tmp_path_factory: pytest.TempPathFactory, order: str):
    path = write_pcap(tmp_path_factory.mktemp("capture") / "drive.pcap", vlp16_packets(3.5), order=order)
    expected = list(velodyne_decoder.read_pcap(str(path), velodyne_decoder.Config(), as_pcl_structs=True))
    with open_recording(path) as recording:
        topic = recording.cloud_topic(None)
        assert topic.name == "/velodyne_points"
        clouds = list(recording.clouds(topic))
    assert len(expected) == 4
    assert len(clouds) == 3  # the last one is half a turn
    for recorded, (stamp, points) in zip(clouds, expected[:3], strict=True):
        cloud = recorded.cloud()
        assert cloud.header.stamp.seconds == pytest.approx(stamp.host, abs=1e-6)
        for name in ("x", "y", "z", "intensity", "ring", "time"):
            np.testing.assert_array_equal(cloud.cloud.columns[name], points[name])
        assert wall_distance_m(cloud.scan().points).max() < 0.05


def test_limits_and_damage():
    decode = decoder_of_scans()
    with pytest.raises(TooLarge):
        decode(raw(velodyne_scan(PACKETS)), Limits(1000, 10**6))
    with pytest.raises(MalformedData, match="no packets"):
        decode(raw(velodyne_scan([])), SCAN_LIMITS)
    good = raw(velodyne_scan(PACKETS[:3]))
    for size in range(0, len(good.body) - 1, 61):
        with pytest.raises(InputError):
            decode(RawMessage("/v", 0, good.body[:size], good.type, CDR), SCAN_LIMITS)
    with pytest.raises(UnsupportedFormat, match="VelodyneScan"):
        decode(raw(velodyne_scan([(5, data[:-1] + b"\x77") for _, data in PACKETS[:3]])), SCAN_LIMITS)

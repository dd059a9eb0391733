"""Ouster's captures, .osf files and bags of packets, held against the SDK; a real sensor's too."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from firstfix.errors import MalformedData, NotFound
from firstfix.recording.messages import CDR, ROS1, RawMessage
from firstfix.recording.ouster import OusterPackets
from firstfix.recording.recording import open_recording
from tests.captures import write_pcap
from tests.every_case import every_case
from tests.lidar_messages import OUSTER, STORES, ouster_packet, raw
from tests.needs import needs, recorded
from tests.ros_samples import write_bag

pytest.importorskip("ouster.sdk", reason=needs("ouster-sdk", "make setup"))
import ouster.sdk.core as sdk

REAL = "formats/original/OS-1-128_v2.3.0_1024x10_lb_n3"
BAG = "formats/original/ouster_512x10_raw_packets.bag"
START_NS = 1_730_000_000 * 10**9
COLUMN_NS = 97_656  # of 1024 columns ten times a second


def sensor() -> sdk.SensorInfo:
    made = sdk.SensorInfo.from_default(sdk.LidarMode(1024, 10))
    made.config.udp_port_lidar = 7502  # without a port the SDK reads its own metadata as "no packets"
    return made


def frame_of(info: sdk.SensorInfo, number: int) -> sdk.LidarFrame:
    """A turn in which every seventh pixel has no return, and some columns were lost."""
    frame, rng = sdk.LidarFrame(info), np.random.default_rng(number)
    ranges = rng.integers(500, 40_000, (frame.h, frame.w)).astype(np.uint32)
    ranges[:, ::7] = 0
    frame.field("RANGE")[:] = ranges
    frame.field("REFLECTIVITY")[:] = rng.integers(0, 200, (frame.h, frame.w))
    frame.timestamp[:] = START_NS + (number * frame.w + np.arange(frame.w)) * COLUMN_NS
    frame.measurement_id[:] = np.arange(frame.w)
    frame.status[:] = 1
    frame.packet_timestamp[:] = frame.timestamp[:: frame.w // len(frame.packet_timestamp)]
    frame.frame_id = 700 + number
    return frame


def packets(info: sdk.SensorInfo, turns: int) -> list[bytes]:
    form = sdk.PacketFormat(info)
    made = [
        one
        for number in range(turns)
        for one in sdk.frame_to_packets(frame_of(info, number), form, info.init_id, int(info.sn or 0))
    ]
    return [one.buf.tobytes() for one in made if isinstance(one, sdk.LidarPacket)]


def check(cloud, info: sdk.SensorInfo, number: int) -> None:
    frame = frame_of(info, number)
    seen = np.asarray(frame.field("RANGE")) > 0
    xyz = sdk.XYZLut(info, use_extrinsics=False)(frame)[seen]
    np.testing.assert_allclose(cloud.cloud.xyz, xyz, atol=1e-5)
    scan = cloud.scan()
    columns = np.broadcast_to(np.arange(frame.w), seen.shape)[seen]
    first = columns.min()
    np.testing.assert_allclose(scan.time_s, (columns - first) * COLUMN_NS * 1e-9, atol=1e-6)
    assert cloud.header.stamp.ns == frame.timestamp[first]
    np.testing.assert_array_equal(cloud.cloud.intensity, np.asarray(frame.field("REFLECTIVITY"))[seen])
    np.testing.assert_array_equal(cloud.cloud.ring, np.nonzero(seen)[0])


@every_case("package, encoding", [(package, encoding) for package in OUSTER for encoding in (CDR, ROS1)])
def test_a_bag_of_packets_gives_the_turns_of_the_sdk(
    tmp_path_factory: pytest.TempPathFactory, package: str, encoding: str
):
    info, types = sensor(), STORES[encoding].types
    metadata = types["std_msgs/msg/String"](info.to_json_string())
    sent = [(START_NS + n, ouster_packet(one, package, encoding)) for n, one in enumerate(packets(info, 2))]
    imu = ouster_packet(bytes(48), package, encoding)
    messages = [
        ("/ouster/metadata", START_NS - 5, metadata),
        ("/ouster/imu_packets", START_NS - 4, imu),
        *(("/ouster/lidar_packets", time_ns, one) for time_ns, one in sent),
    ]
    path = write_bag(tmp_path_factory.mktemp("bag"), "ros1" if encoding == ROS1 else "mcap", messages)
    with open_recording(path) as recording:
        topic = recording.cloud_topic(None)
        assert topic.name == "/ouster/lidar_packets"
        found = list(recording.clouds(topic))
        assert len(found) == 2
        for number, one in enumerate(found):
            assert one.header().frame_id == "os_sensor"
            check(one.cloud(), info, number)


def test_packets_without_metadata_say_what_is_missing(tmp_path: Path):
    info = sensor()
    sent = [
        ("/ouster/lidar_packets", START_NS + n, ouster_packet(one)) for n, one in enumerate(packets(info, 1))
    ]
    path = write_bag(tmp_path, "mcap file", sent)
    with open_recording(path) as recording:
        with pytest.raises(NotFound, match=rf"none in /ouster/metadata.*{path.stem}\.json"):
            recording.cloud_reader(recording.cloud_topic(None))
        path.with_suffix(".json").write_text(info.to_json_string())
        (found,) = recording.clouds(recording.cloud_topic(None))
        check(found.cloud(), info, 0)


@every_case("columns", [0, -1, 2**31 - 1])
def test_metadata_cannot_take_memory_without_limit(columns: int):
    metadata, count = re.subn(
        r'("columns_per_frame"\s*:\s*)\d+', rf"\g<1>{columns}", sensor().to_json_string()
    )
    assert count
    with pytest.raises(MalformedData, match="the sensor's metadata: a picture of"):
        OusterPackets(metadata, "a.bag")


def test_metadata_that_would_end_the_process_is_refused(tmp_path: Path):
    """The SDK divides by the number of columns in a packet."""
    path = write_pcap(tmp_path / "drive.pcap", [(5, b"\x01\x00" + bytes(8000))], 7502)
    metadata = re.sub(r'("columns_per_packet"\s*:\s*)\d+', r"\g<1>0", sensor().to_json_string())
    path.with_suffix(".json").write_text(metadata)
    with (
        pytest.raises(MalformedData, match=r"drive\.json: columns_per_packet is 0"),
        open_recording(path),
    ):
        pass


def test_damage_is_malformed():
    with pytest.raises(MalformedData, match="the sensor's metadata"):
        OusterPackets('{"prod_line": 3}', "a.bag")
    info = sensor()
    reader, good = OusterPackets(info.to_json_string(), "a.bag"), raw(ouster_packet(packets(info, 1)[0]))
    with pytest.raises(MalformedData, match=r"a\.bag: the message of /lidar .*a packet of 100 bytes"):
        reader.add(raw(ouster_packet(bytes(100))))
    for size in range(0, len(good.body), 999):
        with pytest.raises(MalformedData):
            reader.add(RawMessage("/lidar", 0, good.body[:size], good.type, CDR))


@pytest.mark.parametrize("ending", [".pcap", ".osf"])
def test_a_real_sensor_is_read_as_the_sdk_reads_it(ending: str):
    path = recorded(REAL + ending)
    from ouster.sdk import open_source

    expected = []
    for (frame,) in open_source(str(path), collate=False):
        seen = np.asarray(frame.field("RANGE")) > 0
        xyz = sdk.XYZLut(frame.sensor_info, use_extrinsics=False)(frame)[seen]
        expected.append((xyz, np.broadcast_to(frame.timestamp, seen.shape)[seen].astype(np.int64)))
    with open_recording(path) as recording:
        topic = recording.cloud_topic(None)
        assert topic.name == "/ouster/points"
        found = list(recording.clouds(topic))
    assert len(found) == len(expected) == 3
    for one, (xyz, times_ns) in zip(found, expected, strict=True):
        cloud = one.cloud()
        np.testing.assert_allclose(cloud.cloud.xyz, xyz, atol=1e-5)
        scan = cloud.scan()
        np.testing.assert_allclose(scan.time_s, (times_ns - cloud.header.stamp.ns) * 1e-9, atol=1e-6)
        assert 0.099 < scan.time_s.max() < 0.101


def test_a_real_bag_of_packets_is_read():
    with open_recording(recorded(BAG)) as recording:
        topic = recording.cloud_topic(None)
        assert topic.name == "/os_node0/lidar_packets"
        (one,) = recording.clouds(topic)
        scan = one.cloud().scan()
    assert len(scan) == 28_751
    assert 0.099 < scan.time_s.max() < 0.101

"""MCAP files as recorders leave them: of every profile, with anything beside the clouds, cut off."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np
import pytest
import zstandard
from mcap.reader import NonSeekingReader, make_reader
from mcap.writer import CompressionType, IndexType

from firstfix.errors import InvalidOption, MalformedData, NotFound, TooLarge
from firstfix.recording import mcap_records
from firstfix.recording.recording import Recording, is_recording, open_recording
from tests.every_case import every_case
from tests.mcap_files import Message, write_mcap
from tests.ros_samples import CLOUD, ROS1, cdr, cloud_of_points, ros1

S = 10**9
COUNT = 30
POINTS = [np.random.default_rng(n).normal(size=(400 + n, 3)).astype(np.float32) for n in range(COUNT)]
BODIES = [cdr(cloud_of_points(points, stamp_ns=(n + 1) * S)) for n, points in enumerate(POINTS)]


def clouds(topic: str = "/points", count: int = COUNT) -> list[Message]:
    return [(topic, CLOUD, "cdr", b"", (n + 1) * S, BODIES[n]) for n in range(count)]


def mixed() -> list[Message]:
    """A cloud, a text of JSON and something of protobuf, in turn."""
    return [
        message
        for cloud in clouds()
        for message in (
            cloud,
            ("/status", "Status", "json", b"{}", cloud[4] + 5, json.dumps({"at": cloud[4]}).encode()),
            ("/log", "a.Log", "protobuf", b"\x00\xff", cloud[4] + 7, b"\x08\x01"),
        )
    ]


def sizes(recording: Recording, name: str | None = None) -> list[int]:
    """Numbers of points, after a check of them against what was written."""
    found = [recorded.cloud().cloud for recorded in recording.clouds(recording.cloud_topic(name))]
    for cloud in found:
        np.testing.assert_array_equal(cloud.xyz, POINTS[len(cloud) - 400])
    return [len(cloud) for cloud in found]


ALL = [400 + n for n in range(COUNT)]
FORMS: dict[str, dict[str, object]] = {
    "as it is": {},
    "of another profile": {"profile": ""},
    "of profile ros1": {"profile": "ros1"},
    "plain chunks": {"compression": CompressionType.NONE},
    "lz4": {"compression": CompressionType.LZ4},
    "small chunks": {"chunk_size": 6_000},
    "without chunks": {"use_chunking": False},
    "without statistics": {"use_statistics": False},
    "without an index": {"index_types": IndexType.NONE},
    "without channels in the summary": {"repeat_channels": False, "repeat_schemas": False},
    "without a summary": {
        "use_statistics": False,
        "use_summary_offsets": False,
        "index_types": IndexType.NONE,
        "repeat_channels": False,
        "repeat_schemas": False,
    },
}


@every_case("form", FORMS)
def test_clouds_are_read_whatever_is_beside_them(tmp_path_factory: pytest.TempPathFactory, form: str):
    path = write_mcap(tmp_path_factory.mktemp("bag") / "a.mcap", mixed(), **FORMS[form])  # type: ignore[arg-type]
    with open_recording(path) as recording:
        assert recording.notes == []
        assert recording.start_ns == S
        assert [(t.name, t.type, t.encoding, t.count) for t in recording.topics] == [
            ("/log", "a.Log", "protobuf", COUNT),
            ("/points", CLOUD, "cdr", COUNT),
            ("/status", "Status", "json", COUNT),
        ]
        assert sizes(recording) == ALL
        assert len(list(recording.clouds(recording.cloud_topic(None), 11 * S))) == 20
        with pytest.raises(NotFound, match="/status has no clouds but Status"):
            recording.cloud_topic("/status")


def test_messages_come_in_the_order_of_time_as_the_package_mcap_gives_them(tmp_path: Path):
    order = np.random.default_rng(3).permutation(COUNT)
    path = write_mcap(
        tmp_path / "a.mcap", [mixed()[n] for k in order for n in range(3 * k, 3 * k + 3)], chunk_size=9_000
    )
    with path.open("rb") as file, open_recording(path) as recording:
        expected = [(c.topic, m.log_time, m.data) for _, c, m in make_reader(file).iter_messages()]
        read = recording.messages(["/points", "/status", "/log"])
        assert [(m.topic, m.time_ns, m.body) for m in read] == expected


@every_case("share", [0.2, 0.6, 0.9, 0.999])
def test_a_cut_file_is_read_to_its_last_complete_chunk(
    tmp_path_factory: pytest.TempPathFactory, share: float
):
    path = write_mcap(tmp_path_factory.mktemp("bag") / "a.mcap", mixed(), chunk_size=12_000)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    with path.open("rb") as file:
        try:
            expected = []
            for _, channel, message in NonSeekingReader(file).iter_messages(log_time_order=False):
                if channel.topic == "/points":
                    expected.append(message.log_time)
        except Exception:  # it ends with the file
            pass
    with open_recording(path) as recording:
        if share < 0.999:  # there only the summary is cut
            (note,) = recording.notes
            assert "cut off" in note
            assert str(int(share * len(whole))) in note
        read = [recorded.time_ns for recorded in recording.clouds(recording.cloud_topic(None))]
    assert read == expected
    assert read or share < 0.3


def test_a_file_that_is_cut_before_its_first_chunk_is_malformed(tmp_path: Path):
    path = write_mcap(tmp_path / "a.mcap", clouds())
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(MalformedData, match="ends within a record"), open_recording(path):
        pass


def test_ros1_messages_in_mcap_are_read(tmp_path: Path):
    bodies = [ros1(cloud_of_points(points, stores=ROS1, stamp_ns=S)) for points in POINTS]
    messages: list[Message] = [
        ("/points", "sensor_msgs/PointCloud2", "ros1", b"", (n + 1) * S, body)
        for n, body in enumerate(bodies)
    ]
    with open_recording(write_mcap(tmp_path / "a.mcap", messages, profile="ros1")) as recording:
        assert recording.cloud_topic(None).type == CLOUD
        assert sizes(recording) == ALL


def test_two_types_on_one_topic_do_not_mix(tmp_path: Path):
    messages = [
        m for cloud in clouds() for m in (cloud, ("/points", "Cloud", "json", b"{}", cloud[4], b"{}"))
    ]
    with open_recording(write_mcap(tmp_path / "a.mcap", messages)) as recording:
        assert sizes(recording) == sizes(recording, "/points") == ALL


def test_several_topics_must_be_chosen(tmp_path: Path):
    path = write_mcap(tmp_path / "a.mcap", [*clouds("/a"), *clouds("/b")])
    with open_recording(path) as recording, pytest.raises(InvalidOption, match="choose one: /a, /b"):
        recording.cloud_topic(None)


def test_a_record_cannot_take_memory_without_limit(tmp_path: Path):
    """A message outside of chunks that declares an exabyte ends the file, as where one was cut off."""
    path = write_mcap(tmp_path / "a.mcap", clouds(count=2), use_chunking=False)
    data = bytearray(path.read_bytes())
    second = data.rindex(BODIES[1]) - mcap_records.MESSAGE_HEAD.size - 8
    data[second : second + 8] = (1 << 60).to_bytes(8, "little")
    path.write_bytes(data[: second + 3_000])
    with open_recording(path) as recording:
        assert sizes(recording) == [400]
    summary = write_mcap(tmp_path / "b.mcap", clouds(count=2))
    data = bytearray(summary.read_bytes())
    chunk = data.index(b"zstd") - 16  # the unpacked size, the checksum and the name's length stand before
    data[chunk : chunk + 8] = (1 << 40).to_bytes(8, "little")
    summary.write_bytes(data)
    with open_recording(summary) as recording, pytest.raises(TooLarge, match="a chunk has"):
        sizes(recording)


def test_an_ending_may_be_in_capitals(tmp_path: Path):
    path = write_mcap(tmp_path / "A.MCAP", clouds())
    assert is_recording(path)
    with open_recording(path) as recording:
        assert sizes(recording) == ALL


def test_records_without_a_kind_end_a_chunk(tmp_path: Path):
    """A chunk of zeros packs to nothing, and is millions of records without content."""
    body = zstandard.compress(bytes(900))
    chunk = struct.pack("<QQQII", S, S, 900, 0, 4) + b"zstd" + struct.pack("<Q", len(body)) + body
    path = tmp_path / "a.mcap"
    path.write_bytes(
        mcap_records.MAGIC
        + mcap_records.HEAD.pack(mcap_records.HEADER, 8)
        + bytes(8)
        + mcap_records.HEAD.pack(mcap_records.CHUNK, len(chunk))
        + chunk
    )
    with pytest.raises(MalformedData, match="a record without a kind"), open_recording(path):
        pass


def test_a_damaged_chunk_is_named(tmp_path: Path):
    path = write_mcap(tmp_path / "a.mcap", clouds(), compression=CompressionType.NONE)
    data = bytearray(path.read_bytes())
    data[data.index(BODIES[3]) + 2_000] ^= 1
    path.write_bytes(data)
    with open_recording(path) as recording, pytest.raises(MalformedData, match=r"a\.mcap: .*checksum"):
        sizes(recording)


def test_statistics_without_counts_of_the_channels_hide_nothing(tmp_path: Path):
    """The specification: an empty map of counts says that they are not known."""
    path = write_mcap(tmp_path / "a.mcap", clouds())
    data = path.read_bytes()
    counts = struct.pack("<IHQ", 10, 1, COUNT)  # one channel, and its messages
    assert data.count(counts) == 1
    begin = data.index(counts)
    shorter = bytearray(data[:begin] + bytes(4) + data[begin + len(counts) :])
    head = begin - 42 - 8  # the other statistics, and the length of their record
    shorter[head : head + 8] = struct.pack("<Q", 42 + 4)
    path.write_bytes(shorter)
    with open_recording(path) as recording:
        assert (sizes(recording), recording.notes) == (ALL, [])


def test_messages_outside_of_chunks_are_read_beside_those_inside(tmp_path: Path):
    """The specification lets a recorder mix both; its index of chunks names none of those outside."""
    loose, chunked = (
        write_mcap(tmp_path / f"{n}.mcap", messages, use_chunking=bool(n)).read_bytes()
        for n, messages in enumerate((clouds()[15:], clouds()[:15]))
    )
    data_end = mcap_records.HEAD.pack(mcap_records.DATA_END, 4)
    loose = loose[loose.index(BODIES[15]) - 31 : loose.rindex(data_end)]  # 31: heads of record and message
    at = chunked.rindex(data_end)
    summary = at + mcap_records.HEAD.size + 4
    tail = bytearray(chunked[summary:])
    statistics = tail.index(struct.pack("<BQ", mcap_records.STATISTICS, 42 + 4 + 10)) + 9
    tail[statistics : statistics + 8] = struct.pack("<Q", COUNT)
    tail[statistics + 46 : statistics + 56] = struct.pack("<HQ", 1, COUNT)
    footer = len(tail) - mcap_records.FOOTER_BYTES + 9
    tail[footer : footer + 16] = struct.pack("<QQ", summary + len(loose), 0)
    (tmp_path / "a.mcap").write_bytes(chunked[:at] + loose + chunked[at:summary] + tail)
    with open_recording(tmp_path / "a.mcap") as recording:
        assert (sizes(recording), recording.notes) == (ALL, [])

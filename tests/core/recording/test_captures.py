"""Captures of other makers, of several sensors, and damaged ones: refused with what to do."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from firstfix.errors import InputError, MalformedData, NotFound, UnsupportedFormat
from firstfix.recording.pcap_kind import VELODYNE, kind_of
from firstfix.recording.recording import is_recording, open_recording
from tests.captures import vlp16_packets, write_pcap
from tests.every_case import every_case

REFUSED = {
    "Hesai": ([b"\xee\xff\x01\x04" + bytes(1000)], 2368, "packets of a Hesai.*maker's driver"),
    "RoboSense": ([b"\x55\xaa\x05\x0a" + bytes(1244)], 6699, "packets of a RoboSense.*maker's driver"),
    "Livox": ([b"\x00\x44\x05" + bytes(1377)], 56_301, "packets of a Livox.*maker's driver"),
    "nothing of a LiDAR": ([b"hello"], 5353, "no packets of a LiDAR"),
    "nothing": ([], 1, "no packets of a LiDAR"),
}


@every_case("maker", REFUSED)
def test_other_packets_say_what_to_do(tmp_path_factory: pytest.TempPathFactory, maker: str):
    payloads, port, said = REFUSED[maker]
    path = write_pcap(tmp_path_factory.mktemp("capture") / "a.pcap", [(5, one) for one in payloads], port)
    with pytest.raises(UnsupportedFormat, match=said), open_recording(path):
        pass


def test_a_capture_of_wireshark_is_named_with_what_makes_a_plain_one(tmp_path: Path):
    path = tmp_path / "drive.pcapng"
    path.write_bytes(b"\x0a\x0d\x0d\x0a" + bytes(99))
    assert is_recording(path)
    with (
        pytest.raises(UnsupportedFormat, match=r"editcap -F pcap drive\.pcapng plain\.pcap"),
        open_recording(path),
    ):
        pass


def test_a_packet_that_is_shorter_than_it_declares_does_not_matter(tmp_path: Path):
    """An IPv4 head of 60 bytes is declared where 28 follow."""
    path = write_pcap(tmp_path / "a.pcap", [(1, b""), *vlp16_packets(1.2)])
    body = bytearray(path.read_bytes())
    body[24 + 16 + 14] = 0x4F
    path.write_bytes(body)
    assert kind_of(path) == VELODYNE


def test_two_velodynes_in_one_capture_are_not_mixed(tmp_path: Path):
    packets = vlp16_packets(0.2)
    first = write_pcap(tmp_path / "a.pcap", packets).read_bytes()
    second = write_pcap(tmp_path / "b.pcap", packets, source=(192, 168, 1, 202)).read_bytes()
    (tmp_path / "both.pcap").write_bytes(first + second[24:])
    said = r"2 Velodynes: .*tcpdump -r both\.pcap -w one\.pcap src host 192\.168\.1\.201 and udp port 2368"
    with pytest.raises(UnsupportedFormat, match=said), open_recording(tmp_path / "both.pcap"):
        pass


def test_an_ouster_without_its_metadata_says_where_it_is(tmp_path: Path):
    path = write_pcap(tmp_path / "drive.pcap", [(5, b"\x01\x00" + bytes(8000))], 7502)
    with pytest.raises(NotFound, match=r"metadata.*drive\.json"), open_recording(path):
        pass


def test_damaged_captures_are_input_errors(tmp_path: Path):
    good, rng = write_pcap(tmp_path / "good.pcap", vlp16_packets(0.3)).read_bytes(), np.random.default_rng(6)
    path = tmp_path / "a.pcap"
    for body, said in {b"": "no capture", b"\x0a\x0d\x0d\x0a" + bytes(99): "editcap -F pcap"}.items():
        path.write_bytes(body)
        with pytest.raises((MalformedData, UnsupportedFormat), match=said), open_recording(path):
            pass
    for trial in range(60):
        body = bytearray(good)
        if trial % 2:
            body[rng.integers(3_000)] ^= rng.integers(1, 256)
        else:
            body = body[: rng.integers(len(body))]
        path.write_bytes(body)
        with suppress(InputError), open_recording(path) as recording:
            for recorded in recording.clouds(recording.cloud_topic(None)):
                recorded.cloud().scan()


def test_what_is_a_recording_is_told_by_its_name(tmp_path: Path):
    (tmp_path / "bag").mkdir()
    assert not is_recording(tmp_path / "bag")
    (tmp_path / "bag" / "metadata.yaml").write_bytes(b"")
    names = ("a.bag", "a.bag.active", "a.db3", "a.mcap", "a.mcap.zstd", "a.pcap", "a.osf", "bag")
    assert [name for name in names if not is_recording(tmp_path / name)] == []
    assert [name for name in ("a.pcd", "a.bin", "bag.txt", "mcap") if is_recording(tmp_path / name)] == []

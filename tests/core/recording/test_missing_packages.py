"""A package that a recording needs and that is not installed is named, with its extra."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from firstfix.recording import ouster
from firstfix.recording.recording import Recording, open_recording
from tests.captures import vlp16_packets, write_pcap
from tests.lidar_messages import compressed, livox, raw, velodyne_scan
from tests.mcap_files import write_mcap
from tests.ros_samples import cloud_of_points, write_bag


def first(recording: Recording) -> object:
    return next(recording.clouds(recording.cloud_topic(None))).cloud()


def of_bag(folder: Path, message: object) -> None:
    with open_recording(write_bag(folder, "mcap", [("/lidar", 5, message)])) as recording:
        first(recording)


def of_draco(folder: Path) -> None:
    of_bag(folder, compressed(cloud_of_points(np.ones((9, 3))), "draco", b"DRACO"))


def of_velodyne(folder: Path) -> None:
    of_bag(folder, velodyne_scan(vlp16_packets(0.1)))


def of_velodyne_capture(folder: Path) -> None:
    with open_recording(write_pcap(folder / "a.pcap", vlp16_packets(0.1))):
        pass


def of_ouster(folder: Path) -> None:
    ouster.OusterPackets("{}", "a.bag")


def of_foxglove(folder: Path) -> None:
    path = write_mcap(folder / "a.mcap", [("/l", "foxglove.PointCloud", "protobuf", b"", 5, b"")])
    with open_recording(path) as recording:
        first(recording)


@pytest.mark.parametrize(
    ("module", "extra", "read"),
    [
        ("DracoPy", "draco", of_draco),
        ("velodyne_decoder", "velodyne", of_velodyne),
        ("velodyne_decoder", "velodyne", of_velodyne_capture),
        ("ouster", "ouster", of_ouster),
        ("google.protobuf", "service", of_foxglove),
    ],
)
def test_the_extra_is_named(module: str, extra: str, read, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ModuleNotFoundError, match=rf"pip install '\.\[{extra}\]'"):
        read(tmp_path)


def test_what_needs_no_package_is_read_without_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    for module in ("DracoPy", "velodyne_decoder", "ouster", "ouster.sdk.core", "rosbags", "google.protobuf"):
        monkeypatch.setitem(sys.modules, module, None)
    points = np.ones(
        5, [("t", "u4"), *((axis, "f4") for axis in "xyz"), ("i", "u1"), ("tag", "u1"), ("line", "u1")]
    )
    message = raw(livox(points))
    path = write_mcap(tmp_path / "a.mcap", [("/l", message.type, "cdr", b"", 5, message.body)])
    with open_recording(path) as recording:
        assert len(first(recording).cloud) == 5

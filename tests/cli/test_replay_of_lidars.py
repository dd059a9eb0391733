"""``localize --bag`` with recordings that hold no PointCloud2, and with one that was cut off."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from firstfix.answer.localization import Localization, Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.errors import UnsupportedFormat
from firstfix.recording.compressed_cloud import DRACO_LOSES
from firstfix.scan.scan import Scan
from firstfix_cli.bags.replay import Replay, Replayed, replay
from firstfix_cli.limited_reader import read_scan
from firstfix_cli.main import run
from tests import ros_samples
from tests.captures import vlp16_packets, write_pcap
from tests.core.recording.test_compressed_cloud import draco
from tests.lidar_messages import STAMP_NS, compressed, livox
from tests.ros_samples import cloud, write_bag

MS = 10**6


def replayed(
    path: Path, topics: tuple[str, ...] = (), **wanted: object
) -> tuple[list[Scan], list[Replayed], list[str]]:
    """The scans that were asked, the answers, and the lines that were said."""
    asked: list[Scan] = []
    said: list[str] = []

    def ask(scan: Scan, options: LocalizeOptions) -> Localization:
        asked.append(scan)
        return Localization(Verdict.REJECTED)

    answers = list(replay(Replay(path, topics, **wanted), ask, LocalizeOptions(), said.append))  # type: ignore[arg-type]
    return asked, answers, said


def of_livox(number: int) -> object:
    """A cloud of 50 points at 10 Hz."""
    points = np.zeros(
        50, [("t", "u4"), *((axis, "f4") for axis in "xyz"), ("i", "u1"), ("tag", "u1"), ("line", "u1")]
    )
    points["x"], points["y"], points["t"] = number + 1, np.arange(50), np.arange(50) * 2 * MS
    message = livox(points)
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(STAMP_NS + number * 100 * MS, 10**9)
    return message


def test_what_draco_has_lost_is_said_once(tmp_path: Path):
    points = np.zeros(300, [(axis, "<f4") for axis in "xyz"])
    for number, axis in enumerate("xyz"):
        points[axis] = np.random.default_rng(number).uniform(-9, 9, 300)
    plain = cloud(points, stamp_ns=STAMP_NS, frame_id="lidar")
    packed = compressed(plain, "draco", draco(points))
    messages = [("/points/draco", STAMP_NS + number * 100 * MS, packed) for number in range(3)]
    asked, _, said = replayed(write_bag(tmp_path, "mcap", messages))
    assert len(asked) == 3
    assert [line for line in said if "loss" in line] == [f"/points/draco: {DRACO_LOSES}"]


def test_a_livox_is_replayed_beside_another_lidar(tmp_path: Path):
    fixed = [("livox_frame", "top", np.eye(4))]
    messages = [("/tf_static", STAMP_NS - 1, ros_samples.transforms(fixed))]
    records = np.zeros(9, [*((axis, "<f4") for axis in "xyz"), ("t", "<u4")])
    for number in range(4):
        records["x"], records["y"], records["t"] = 100 + number, np.arange(9), np.arange(9) * 12 * MS
        top = cloud(records, stamp_ns=STAMP_NS + (number * 100 + 30) * MS, frame_id="top")
        at = STAMP_NS + (number * 100 + 100) * MS
        messages += [("/livox/lidar", at, of_livox(number)), ("/top", at + 1, top)]
    path = write_bag(tmp_path, "mcap", messages)
    asked, answers, said = replayed(path, ("/livox/lidar", "/top"))
    assert said == []
    assert [one.header.stamp.ns for one in answers] == [STAMP_NS + number * 100 * MS for number in range(4)]
    for number, scan in enumerate(asked):
        assert len(scan) == 59
        assert (scan.points[:50, 0] == number + 1).all()
        assert scan.time_s is not None
        np.testing.assert_allclose(scan.time_s[[0, 49, 50, 58]], [0.0, 0.098, 0.03, 0.126], atol=1e-6)
    assert len(replayed(path, ("/livox/lidar",), every=2, start_s=0.05)[0]) == 2


def test_a_capture_is_replayed(tmp_path: Path):
    asked, answers, said = replayed(write_pcap(tmp_path / "drive.pcap", vlp16_packets(2.5)), count=2)
    assert len(asked) == 2
    assert said == []
    assert answers[0].header.frame_id == "velodyne"
    assert asked[1].time_s is not None


def test_a_recording_that_was_cut_off_says_so(tmp_path: Path):
    path = write_bag(tmp_path, "mcap file", [("/points", STAMP_NS + n, of_livox(n)) for n in range(2000)])
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    asked, _, (said,) = replayed(path)
    assert 100 < len(asked) < 2000
    assert said.startswith(f"{path}: {path.name} was cut off")


def test_a_recording_is_measured_by_its_first_cloud(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    path = write_pcap(tmp_path / "drive.pcap", vlp16_packets(1.5))
    with pytest.raises(SystemExit) as ended:
        run(["sensor", str(path), "--json"])
    assert not ended.value.code
    measured = json.loads(capsys.readouterr().out)
    assert "vlp-16" in json.dumps(measured)
    with pytest.raises(UnsupportedFormat, match=r"`firstfix localize --bag drive\.pcap` takes recordings"):
        read_scan(path)

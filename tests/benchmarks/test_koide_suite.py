"""A small world in the layout of Koide's data set: maps, ROS 2 bags and true poses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ros_samples
from benchmarks.koide.drawn_scans import draw_scans
from benchmarks.koide.layout import CLOUDS, IMU, RECORDINGS, Files, TruePoses, files_of
from benchmarks.koide.report import report
from benchmarks.koide.suite import measure, run
from firstfix.transform import from_quaternion, pose_error, quaternion_of
from small_world import CONFIG

S = 10**9
START_S = 1_699_000_000
LIVOX = [
    ("x", "<f4"),
    ("y", "<f4"),
    ("z", "<f4"),
    ("t", "<u4"),
    ("intensity", "<f4"),
    ("tag", "u1"),
    ("line", "u1"),
]


def livox_cloud(points: np.ndarray, stamp_ns: int):
    records = np.zeros(len(points), LIVOX)
    for axis, name in enumerate("xyz"):
        records[name] = points[:, axis]
    return ros_samples.cloud(records, stamp_ns=stamp_ns, frame_id="livox_frame")


@pytest.fixture(scope="module")
def data(small_map, small_scans, tmp_path_factory) -> Path:
    """Eight scans, in each bag four, and one more of a covered sensor that has no true pose; IMU in g."""
    folder = tmp_path_factory.mktemp("koide")
    (folder / "map_outdoor_hard.ply").write_bytes(small_map.read_bytes())
    (folder / "gt" / "gt").mkdir(parents=True)
    lines = []
    for part in range(2):
        messages: list[tuple[str, int, object]] = []
        for number, (scan, T_map_sensor) in list(enumerate(small_scans))[4 * part : 4 * part + 4]:
            stamp_ns = (START_S + number) * S
            resting = ros_samples.imu(T_map_sensor[2, :3], stamp_ns=stamp_ns, frame_id="livox_frame")
            messages.append((IMU, stamp_ns, resting))
            messages.append((CLOUDS, stamp_ns + 10**7, livox_cloud(scan.points, stamp_ns)))
            numbers = (*T_map_sensor[:3, 3], *quaternion_of(T_map_sensor))
            lines += [f"{START_S + number}.0 " + " ".join(f"{v:.9f}" for v in numbers)]
        messages.append((CLOUDS, (START_S + 900) * S, livox_cloud(np.zeros((0, 3)), (START_S + 900) * S)))
        parent = folder / "sequences" / RECORDINGS[0].parts[part]
        parent.mkdir(parents=True)
        ros_samples.write_bag(parent, "sqlite3", messages)
    (folder / "gt" / "gt" / "traj_lidar_outdoor_hard_01.txt").write_text("\n".join(lines) + "\n")
    return folder


def test_files_are_found_and_missing_ones_are_named(data: Path):
    hard, other, kidnap = (files_of(data, recording) for recording in RECORDINGS)
    assert isinstance(hard, Files)
    assert [bag.parent.name for bag in hard.bags] == ["outdoor_hard_01a", "outdoor_hard_01b"]
    assert isinstance(other, str)
    assert "no traj_lidar_outdoor_hard_02.txt" in other
    assert "map_outdoor_kidnap.ply" in str(kidnap)


def test_scans_are_drawn_with_their_pose_and_gravity(data: Path, small_scans):
    files = files_of(data, RECORDINGS[0])
    assert isinstance(files, Files)
    poses = TruePoses.read(files.poses)
    every = draw_scans(files.bags, poses, 99, seed=1)
    assert len(every) == 8  # the covered ones have no true pose
    for one, (scan, T_map_sensor) in zip(every, small_scans, strict=False):
        assert pose_error(T_map_sensor, one.T_map_sensor) == pytest.approx((0, 0), abs=1e-4)
        np.testing.assert_allclose(one.gravity, -T_map_sensor[2, :3], atol=1e-6)
        np.testing.assert_array_equal(one.cloud.scan().points, scan.points)
    few = draw_scans(files.bags, poses, 3, seed=1)
    assert len({one.cloud.header.stamp for one in few}) == 3
    assert [a.cloud.header for a in few] == [b.cloud.header for b in draw_scans(files.bags, poses, 3, seed=1)]


def test_true_poses_are_interpolated_but_not_over_gaps():
    turned = from_quaternion([1.0, 0, 0], [0, 0, np.sin(0.1), np.cos(0.1)])
    poses = TruePoses(np.array([5.0, 5.1, 9.0]), [np.eye(4), turned, turned])
    half = from_quaternion([0.5, 0, 0], [0, 0, np.sin(0.05), np.cos(0.05)])
    between = poses.at(5.05)
    assert between is not None
    np.testing.assert_allclose(between, half, atol=1e-9)
    np.testing.assert_allclose(poses.at(9.0), turned, atol=1e-9)
    assert [poses.at(t) for t in (4.9, 7.0, 9.1)] == [None] * 3


def test_the_figures_of_a_small_copy(data: Path):
    figures = measure(data, 4, CONFIG)
    assert set(figures["maps"]) == {"map_outdoor_hard.ply"}
    found = figures["recordings"]["outdoor_hard_01"]
    for gravity in ("estimated", "given"):
        assert found[gravity]["n"] == 4
        assert found[gravity]["wrong"] == 0
        assert found[gravity]["against"]["truth"]["right_first"] >= 0.75
        assert found[gravity]["success"]["1m_5deg"] >= found[gravity]["success"]["0.2m_1deg"]
    assert figures["total"]["given"]["n"] == 4
    text = report(figures)
    assert "| outdoor_hard_01 | estimated | 4 |" in text
    assert "| outdoor_kidnap | skipped: " in text


def test_without_the_data_it_says_so():
    assert "--data" in run(quick=True)["skipped"]

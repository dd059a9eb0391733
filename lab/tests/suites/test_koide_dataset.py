"""A small world in the layout of Koide's data set: maps, ROS 2 bags and true poses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from firstfix.scan_file import read_scan_file
from firstfix.transform import from_quaternion, pose_error, quaternion_of
from firstfix_cli.poses_csv import read_poses_csv
from tests import ros_samples
from tests.koide_dataset import CLOUDS, TruePoses, draw_scans, write_drawn_scans
from tests.recorded_data import Dataset, PoseTable

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
    """Eight scans, in each bag four, and one more of a covered sensor: the second has a true pose."""
    folder = tmp_path_factory.mktemp("koide")
    (folder / "map_outdoor_hard.ply").write_bytes(small_map.read_bytes())
    (folder / "gt" / "gt").mkdir(parents=True)
    lines = []
    for part in range(2):
        messages: list[tuple[str, int, object]] = []
        for number, (scan, T_map_sensor) in list(enumerate(small_scans))[4 * part : 4 * part + 4]:
            stamp_ns = (START_S + number) * S
            messages.append((CLOUDS, stamp_ns + 10**7, livox_cloud(scan.points, stamp_ns)))
            numbers = (*T_map_sensor[:3, 3], *quaternion_of(T_map_sensor))
            lines += [f"{START_S + number}.0 " + " ".join(f"{v:.9f}" for v in numbers)]
        covered_s = START_S + (900, 8)[part]
        messages.append((CLOUDS, covered_s * S, livox_cloud(np.zeros((0, 3)), covered_s * S)))
        parent = folder / "sequences" / f"outdoor_hard_01{'ab'[part]}"
        parent.mkdir(parents=True)
        ros_samples.write_bag(parent, "sqlite3", messages)
    lines.append(f"{START_S + 8}.0 0 0 0 0 0 0 1")
    (folder / "gt" / "gt" / "traj_lidar_outdoor_hard_01.txt").write_text("\n".join(lines) + "\n")
    return folder


def test_scans_are_drawn_with_their_pose(data: Path, small_scans):
    poses = TruePoses.read(data / "gt" / "gt" / "traj_lidar_outdoor_hard_01.txt")
    bags = sorted(file.parent for file in data.rglob("metadata.yaml"))
    every = draw_scans(bags, poses, 99)
    assert len(every) == 9  # one of the covered ones has no true pose
    for (cloud, T_map_sensor), (scan, T_true) in zip(every[:8], small_scans, strict=False):
        assert pose_error(T_true, T_map_sensor) == pytest.approx((0, 0), abs=1e-4)
        np.testing.assert_array_equal(cloud.scan().points, scan.points)
    few = [cloud.header for cloud, _ in draw_scans(bags, poses, 3)]
    assert len({header.stamp for header in few}) == 3
    assert few == [cloud.header for cloud, _ in draw_scans(bags, poses, 3)]


def test_true_poses_are_interpolated_but_not_over_gaps():
    turned = from_quaternion([1.0, 0, 0], [0, 0, np.sin(0.1), np.cos(0.1)])
    poses = TruePoses(np.array([5.0, 5.1, 9.0]), [np.eye(4), turned, turned])
    half = from_quaternion([0.5, 0, 0], [0, 0, np.sin(0.05), np.cos(0.05)])
    between = poses.at(5.05)
    assert between is not None
    np.testing.assert_allclose(between, half, atol=1e-9)
    np.testing.assert_allclose(poses.at(9.0), turned, atol=1e-9)
    assert [poses.at(t) for t in (4.9, 7.0, 9.1)] == [None] * 3


def test_it_becomes_a_data_set_without_a_trajectory(data: Path, small_scans, tmp_path: Path):
    raw = Dataset(
        "outdoor_hard",
        data.name,
        "map.ply",
        "{}",
        {"authors": PoseTable("eval.csv")},
        None,
        "sensor.yaml",
        root=data.parent,
        convert=write_drawn_scans,
    )
    ready = raw.converted(tmp_path)
    assert ready.map_path.read_bytes() == (data / "map_outdoor_hard.ply").read_bytes()
    assert ready.write_trajectory(tmp_path / "trajectory.csv") is None
    assert ready.config == {"sensor": {"preset": "mid-360", "mount_height_m": 1.2}}
    rows = read_poses_csv(ready.write_queries(tmp_path / "poses.csv"))
    assert [len(read_scan_file(row.path)) for row in rows] == [*(len(scan) for scan, _ in small_scans[:8]), 0]

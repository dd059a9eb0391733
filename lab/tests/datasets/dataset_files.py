"""Recordings in the formats of public data sets, spelt out as their authors describe them."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from firstfix.scan.scan import Scan
from tests.lidar_messages import livox
from tests.ros_samples import cloud_of_points, stores_of, write_bag

Posed = tuple[Scan, NDArray[np.float64]]  # and T_map_sensor
BEGIN_NS = 1_600_000_000_000_000_000
PERIOD_NS = 100_000_000
FLIP = np.diag([1.0, -1, -1, 1])


def transform(x: float, y: float, z: float, rotation: Rotation | None = None) -> NDArray[np.float64]:
    T = np.eye(4)
    T[:3, 3] = x, y, z
    if rotation is not None:
        T[:3, :3] = rotation.as_matrix()
    return T


def stamps(count: int) -> list[int]:
    return [BEGIN_NS + k * PERIOD_NS for k in range(count)]


def bodies(posed: Sequence[Posed], T_body_sensor: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    return [T_map_sensor @ np.linalg.inv(T_body_sensor) for _, T_map_sensor in posed]


def words(T: NDArray[np.float64], separator: str) -> str:
    numbers = [*T[:3, 3], *Rotation.from_matrix(T[:3, :3]).as_quat()]
    return separator.join(f"{number:.9f}" for number in numbers)


def write_nclt(folder: Path, posed: Sequence[Posed]) -> Path:
    """X forward, y right, z down; the points in the body's frame, 5 mm steps; Euler angles; microseconds."""
    session = folder / "2012-01-08"
    (session / "velodyne_sync").mkdir(parents=True)
    T_body_sensor = transform(0.002, 0.004, 0.957)
    lines = []
    for (scan, _), T, stamp in zip(posed, bodies(posed, T_body_sensor), stamps(len(posed)), strict=True):
        in_body = (scan.points + T_body_sensor[:3, 3]) * [1, -1, -1]
        steps = np.rint((in_body + 100) / 0.005).astype(np.int64)
        body = b"".join(struct.pack("<HHHBB", *row, 7, 3) for row in steps.tolist())
        (session / "velodyne_sync" / f"{stamp // 1000}.bin").write_bytes(body)
        down = FLIP @ T @ FLIP
        heading, pitch, roll = Rotation.from_matrix(down[:3, :3]).as_euler("ZYX")
        numbers = [stamp // 1000, *down[:3, 3], roll, pitch, heading]
        lines.append(",".join(repr(float(number)) if k else str(number) for k, number in enumerate(numbers)))
    lines.insert(0, f"{BEGIN_NS // 1000 - 500_000},nan,nan,nan,nan,nan,nan")
    (session / "groundtruth_2012-01-08.csv").write_text("\n".join(lines) + "\n")
    return session


def write_mulran(folder: Path, posed: Sequence[Posed]) -> Path:
    """float32 x y z intensity; the 12 numbers of the base's pose; nanoseconds."""
    (folder / "KAIST01" / "Ouster").mkdir(parents=True)
    T_base_sensor = transform(1.7042, -0.021, 1.8047, Rotation.from_euler("z", 179.6654, degrees=True))
    lines = []
    for (scan, _), T, stamp in zip(posed, bodies(posed, T_base_sensor), stamps(len(posed)), strict=True):
        rows = np.column_stack([scan.points, np.ones(len(scan))]).astype("<f4")
        (folder / "KAIST01" / "Ouster" / f"{stamp}.bin").write_bytes(rows.tobytes())
        lines.append(",".join([str(stamp), *(f"{number:.9f}" for number in T[:3].reshape(-1))]))
    (folder / "KAIST01" / "global_pose.csv").write_text("\n".join(lines) + "\n")
    return folder / "KAIST01"


HELIPR = {  # of the data set's own tools: format of a point after x y z
    "Ouster": ("<ffffIHHH", (5.0, 100, 3, 4, 9)),
    "Velodyne": ("<ffffHf", (5.0, 3, 0.01)),
    "Avia": ("<fffBBBI", (5, 0, 2, 100)),
    "Aeva": ("<fffffiBf", (5.0, 0.1, 100, 2, 8.0)),
}


def write_helipr(folder: Path, posed: Sequence[Posed], lidar: str) -> Path:
    """Packed records; poses of the sensor itself; nanoseconds."""
    drive = folder / "KAIST04"
    (drive / "LiDAR" / lidar).mkdir(parents=True)
    (drive / "LiDAR_GT").mkdir(exist_ok=True)
    form, more = HELIPR[lidar]
    lines = []
    # Aeva's records have an intensity after 1691936557946849179 ns only
    shift = 10**17 if lidar == "Aeva" else 0
    for (scan, T), begin in zip(posed, stamps(len(posed)), strict=True):
        body = b"".join(struct.pack(form, *point, *more) for point in scan.points.tolist())
        (drive / "LiDAR" / lidar / f"{begin + shift}.bin").write_bytes(body)
        lines.append(f"{begin + shift} {words(T, ' ')}")
    (drive / "LiDAR_GT" / f"global_{lidar}_gt.txt").write_text("\n".join(lines) + "\n")
    return drive


def write_hilti(folder: Path, posed: Sequence[Posed]) -> Path:
    """A ROS 1 bag; poses of the IMU in seconds; the ground truth's name has one underscore more."""
    rotation = Rotation.from_quat([0.7071068, -0.7071068, 0, 0])
    T_imu_sensor = transform(-0.001, -0.00855, 0.055, rotation)
    bag = write_bag(folder, "ros1", _messages("/hesai/pandar", posed, "ros1"))
    bag = bag.rename(folder / "exp04_construction.bag")
    lines = [
        f"{stamp // 10**9}.{stamp % 10**9:09d} {words(T, ' ')}"
        for stamp, T in zip(stamps(len(posed)), bodies(posed, T_imu_sensor), strict=True)
    ]
    (folder / "exp_04_construction_imu.txt").write_text("\n".join(lines) + "\n")
    return bag


def write_recorded(folder: Path, posed: Sequence[Posed], kind: str = "mcap") -> Path:
    """Any recording with a trajectory of its sensor beside it; of a Livox, which sends no PointCloud2."""
    layout = [
        ("t", "u4"),
        *((axis, "f4") for axis in "xyz"),
        *((name, "u1") for name in ("i", "tag", "line")),
    ]
    messages = []
    for (scan, _), stamp in zip(posed, stamps(len(posed)), strict=True):
        points = np.zeros(len(scan), layout)
        for number, axis in enumerate("xyz"):
            points[axis] = scan.points[:, number]
        message = livox(points)
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
        messages.append(("/livox/lidar", stamp, message))
    lines = [
        f"{stamp // 10**9}.{stamp % 10**9:09d} {words(T, ' ')}"
        for stamp, (_, T) in zip(stamps(len(posed)), posed, strict=True)
    ]
    bag = write_bag(folder, kind, messages)
    (folder / f"{bag.name}.tum").write_text("\n".join(lines) + "\n")
    return bag


def write_newer_college_files(folder: Path, posed: Sequence[Posed]) -> Path:
    """2020: ascii PCD a scan, poses of the left camera."""
    scans = folder / "raw_format" / "ouster_scan"
    scans.mkdir(parents=True)
    for (scan, _), stamp in zip(posed, stamps(len(posed)), strict=True):
        header = (
            "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
            f"WIDTH {len(scan)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(scan)}\nDATA ascii\n"
        )
        rows = "\n".join(f"{x:.5f} {y:.5f} {z:.5f}" for x, y, z in scan.points.tolist())
        (scans / f"cloud_{stamp // 10**9}_{stamp % 10**9}.pcd").write_text(header + rows + "\n")
    rotation = Rotation.from_quat([0, 0, 0.924, 0.383])
    (folder / "ground_truth").mkdir()
    _write_newer_college_poses(
        folder / "ground_truth" / "registered_poses.csv", posed, transform(-0.084, -0.025, 0.05, rotation)
    )
    return folder


def write_newer_college_bags(folder: Path, posed: Sequence[Posed]) -> Path:
    """2021: bags in a folder, poses of the base."""
    half = len(posed) // 2
    messages = _messages("/os_cloud_node/points", posed, "ros1")
    for number, part in enumerate((messages[:half], messages[half:])):
        bag = write_bag(folder, "ros1", part)
        bag.rename(folder / f"2021-07-01-10-37-38_{number}-quad-easy.bag")
    _write_newer_college_poses(folder / "gt-nc-quad-easy.csv", posed, transform(0, 0, 0.09069))
    return folder


def _write_newer_college_poses(
    path: Path, posed: Sequence[Posed], T_body_sensor: NDArray[np.float64]
) -> None:
    lines = ["#sec,nsec,x,y,z,qx,qy,qz,qw"]
    for T, stamp in zip(bodies(posed, T_body_sensor), stamps(len(posed)), strict=True):
        lines.append(f"{stamp // 10**9},{stamp % 10**9},{words(T, ',')}")
    path.write_text("\n".join(lines) + "\n")


def _messages(topic: str, posed: Sequence[Posed], kind: str) -> list[tuple[str, int, object]]:
    stores = stores_of(kind)
    return [
        (
            topic,
            stamp + 5_000_000,
            cloud_of_points(scan.points, stores=stores, stamp_ns=stamp, frame_id="lidar"),
        )
        for (scan, _), stamp in zip(posed, stamps(len(posed)), strict=True)
    ]


@dataclass(frozen=True)
class Format:
    """A data set's format.

    Attributes:
        dataset: its name on the command line.
        step_m: the format rounds coordinates to this.
    """

    dataset: str
    write: Callable[[Path, Sequence[Posed]], Path]
    lidar: str | None = None
    step_m: float = 1e-4


FORMATS = {
    "nclt": Format("nclt", write_nclt, step_m=0.005),
    "mulran": Format("mulran", write_mulran),
    **{
        f"helipr {lidar}": Format(
            "helipr", lambda folder, posed, lidar=lidar: write_helipr(folder, posed, lidar), lidar
        )
        for lidar in HELIPR
    },
    "hilti": Format("hilti", write_hilti),
    "recording": Format("recording", write_recorded),
    "newer_college files": Format("newer_college", write_newer_college_files),
    "newer_college bags": Format("newer_college", write_newer_college_bags),
}

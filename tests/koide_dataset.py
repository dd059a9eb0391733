"""Koide's Hard Point Cloud Localization Dataset: single scans of a Mid-360, drawn from its bags."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from firstfix.errors import InvalidScan
from firstfix.formats.point_cloud import SCAN_LIMITS
from firstfix.recording.recording import open_recording
from firstfix.ros import point_cloud2
from firstfix.ros.cdr import MessageReader
from firstfix.ros.header import read_header
from firstfix.ros.point_cloud2 import StampedCloud, decode_point_cloud2
from firstfix.transform import Matrix, make_transform
from firstfix_builder.sources.read_map import read_trajectory
from tests.pose_rows import POSE, numbers_of, write_rows

CLOUDS = "/livox/points"
GAP_S = 0.25  # between true poses; none is interpolated over a longer one
SCANS, SEED = 200, 1  # drawn from each recording
SENSOR = "preset: mid-360\nmount_height_m: 1.2\n"  # carried by hand
NOTHING_SEEN = np.zeros((0, 3), np.float32)


def write_drawn_scans(source: Path, out: Path) -> None:
    """Writes ``map.ply``, ``sensor.yaml``, ``eval.csv`` and the drawn scans of every recording.

    Args:
        source: folder with ``map_*.ply`` and, in any folders below it, ``traj_lidar_NAME.txt`` of each
            recording and the ROS 2 bags of its parts, each in a folder whose name begins with NAME.
        out: an existing folder.
    """
    (map_path,) = source.glob("map_*.ply")
    (out / "map.ply").symlink_to(map_path.resolve())
    (out / "sensor.yaml").write_text(SENSOR)
    rows = []
    for poses in sorted(source.rglob("traj_lidar_*.txt")):
        name = poses.stem.removeprefix("traj_lidar_")
        drawn = draw_scans(_bags(source, name), TruePoses.read(poses), SCANS)
        for number, (cloud, T_map_sensor) in enumerate(drawn):
            file = f"{name}_{number:03}.npy"
            np.save(out / file, _points(cloud))
            rows.append([file, *numbers_of(T_map_sensor)])
    write_rows(out / "eval.csv", ("scan", *POSE), rows)


def draw_scans(bags: Iterable[Path], true_poses: TruePoses, count: int) -> list[tuple[StampedCloud, Matrix]]:
    """Draws clouds that have a true pose, all with the same chance, in one pass over the bags.

    Returns:
        At most ``count`` of them with T_map_sensor, in the order of time.

    Raises:
        NotFound: a bag has no clouds.
        MalformedData: a bag is damaged.
    """
    rng = np.random.default_rng(SEED)
    drawn: list[tuple[StampedCloud, Matrix]] = []
    seen = 0
    for path in bags:
        with open_recording(path) as bag:
            bag.check_topic(CLOUDS, point_cloud2.TYPE)
            for message in bag.messages([CLOUDS]):
                stamp = read_header(MessageReader("PointCloud2", message.body, ros1=message.ros1)).stamp
                T_map_sensor = true_poses.at(stamp.ns / 1e9)
                if T_map_sensor is None:
                    continue
                seen += 1
                place = len(drawn) if len(drawn) < count else int(rng.integers(seen))  # Vitter's algorithm R
                if place < count:
                    cloud = decode_point_cloud2(message.body, SCAN_LIMITS, ros1=message.ros1)
                    drawn[place : place + 1] = [(cloud, T_map_sensor)]
    return sorted(drawn, key=lambda one: one[0].header.stamp)


class TruePoses:
    """True poses of a sensor over time, interpolated.

    Args:
        stamp_s: (n,) in ascending order.
        T_map_sensor: (n, 4, 4), n >= 2.
    """

    def __init__(self, stamp_s: NDArray[np.float64], T_map_sensor: Sequence[Matrix]) -> None:
        poses = np.asarray(T_map_sensor)
        self._stamp_s, self._position_m = stamp_s, poses[:, :3, 3]
        self._turn = Slerp(stamp_s, Rotation.from_matrix(poses[:, :3, :3]))

    @classmethod
    def read(cls, path: Path) -> TruePoses:
        """Reads a file with ``stamp x y z qx qy qz qw`` in each line (TUM).

        Raises:
            MalformedData: it is no such file.
        """
        poses = read_trajectory(path)
        stamp_s = np.loadtxt(path, usecols=0)
        order = np.unique(stamp_s, return_index=True)[1]
        return cls(stamp_s[order], poses[order])

    def at(self, stamp_s: float) -> Matrix | None:
        """Returns the (4, 4) pose at this time; None where the true poses have a gap, begin or end."""
        after = int(np.searchsorted(self._stamp_s, stamp_s))
        if after < len(self._stamp_s) and self._stamp_s[after] == stamp_s:
            before = after
        elif 0 < after < len(self._stamp_s) and self._stamp_s[after] - self._stamp_s[after - 1] <= GAP_S:
            before = after - 1
        else:
            return None
        at = [
            np.interp(stamp_s, self._stamp_s[before : after + 1], p[before : after + 1])
            for p in self._position_m.T
        ]
        return make_transform(self._turn(stamp_s).as_matrix(), at)


def _bags(source: Path, recording: str) -> Iterator[Path]:
    for file in sorted(source.rglob("metadata.yaml")):
        if any(part.startswith(recording) for part in file.parent.relative_to(source).parts):
            yield file.parent


def _points(cloud: StampedCloud) -> NDArray[np.float32]:
    try:
        return cloud.scan().points
    except InvalidScan:  # the sensor was covered
        return NOTHING_SEEN

"""Newer College (Ramezani et al., IROS 2020; Zhang et al., 2021): a college, Ouster carried by hand.

raw_format/ouster_scan/cloud_1583836591_182590976.pcd    2020, OS1-64, as files
ground_truth/registered_poses.csv                        seconds, nanoseconds, x y z qx qy qz qw

*.bag                                                    or bags: 2020 /os1_cloud_node/points,
registered_poses.csv or gt-*.csv                         2021 (OS0-128) /os_cloud_node/points
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from firstfix.errors import NotFound
from firstfix.scan_file import read_scan_file
from firstfix.transform import from_quaternion
from firstfix_builder.sources.read_map.file_errors import naming
from firstfix_builder.sources.read_map.rigid import rigid_from_quaternions

from .bag_clouds import BagClouds, bags_in
from .ground_truth import NS, GroundTruth, check_stamps, read_rows, read_tum
from .recording import Recording
from .scan_files import ScanFiles, content_of, files_by_stamp, first_file

# 2020: the poses are those of the left camera, which looks 45 degrees aside of the LiDAR's connector.
T_CAMERA_SENSOR = from_quaternion([-0.084, -0.025, 0.050], [0.0, 0.0, 0.924, 0.383])
# 2021: those of the device's base, 9 cm below the LiDAR, with the same axes.
T_BASE_SENSOR = from_quaternion([0.0, 0.0, 0.09069], [0.0, 0.0, 0.0, 1.0])
TOPIC_2020, TOPIC_2021 = "/os1_cloud_node/points", "/os_cloud_node/points"


def open_newer_college(path: Path) -> Recording:
    """Open the folder of an experiment: scans as files (2020), or bags (2020 and 2021).

    Raises:
        NotFound: it lacks scans or ground truth.
        MalformedData, TooLarge: a bag or the ground truth is damaged.
    """
    scans = path / "raw_format" / "ouster_scan"
    if scans.is_dir():
        truth = _truth(first_file(path / "ground_truth" / "registered_poses.csv"))
        return ScanFiles(
            files_by_stamp(scans, "cloud_*.pcd", _stamp_ns), truth, T_CAMERA_SENSOR, read_scan_file
        )
    if (path / "registered_poses.csv").is_file():
        return BagClouds(bags_in(path), TOPIC_2020, _truth(path / "registered_poses.csv"), T_CAMERA_SENSOR)
    truths = sorted([*path.glob("gt-*.csv"), *path.glob("gt_*.csv")])
    if len(truths) != 1:
        raise NotFound(
            f"{path}: no raw_format/ouster_scan, and not one ground truth registered_poses.csv or gt-*.csv "
            f"beside bags, but {len(truths)}"
        )
    return BagClouds(bags_in(path), TOPIC_2021, _truth(truths[0]), T_BASE_SENSOR)


def _truth(path: Path) -> GroundTruth:
    if b"," not in content_of(path)[:4096]:  # so is that of parkland_mound
        return read_tum(path)
    rows = read_rows(path, 9, delimiter=",")
    with naming(path):
        poses = rigid_from_quaternions(rows[:, 2:5], rows[:, 5:])
        check_stamps(rows[:, 0] * NS + rows[:, 1])
    return GroundTruth.of(path, rows[:, 0].astype(np.int64) * NS + rows[:, 1].astype(np.int64), poses)


def _stamp_ns(stem: str) -> int:
    """Of ``cloud_SECONDS_NANOSECONDS``."""
    _, seconds, nanoseconds = stem.split("_")
    return int(seconds) * NS + int(nanoseconds)

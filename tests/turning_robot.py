"""Scans of a robot that turns on the spot: every second one makes the map, the others are asked."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from firstfix.scan.reduction import voxel_means
from firstfix.scan_file import read_scan_file
from firstfix.transform import transform_points
from firstfix_builder.sources.read_map import read_trajectory
from tests.pose_rows import POSE, numbers_of, write_rows

MAP_M = 25.0  # single returns further off lie apart
VOXEL_M = 0.1


def write_turning_robot(source: Path, out: Path) -> None:
    """Writes ``map.xyz``, ``trajectory.csv`` and ``eval.csv``, and links the scans that are asked.

    Args:
        source: folder with ``0.pcd``, ``1.pcd`` and so on, and ``pose.json``.
        out: an existing folder.
    """
    poses = read_trajectory(source / "pose.json")
    mapped, asked = range(0, len(poses), 2), range(1, len(poses), 2)
    seen = [transform_points(poses[k], read_scan_file(source / f"{k}.pcd").points) for k in mapped]
    cloud = np.concatenate(seen)
    near = cloud[np.linalg.norm(cloud - poses[0][:3, 3], axis=1) < MAP_M]
    np.savetxt(out / "map.xyz", voxel_means(near, VOXEL_M), fmt="%.4f")
    write_rows(out / "trajectory.csv", POSE, [numbers_of(poses[k]) for k in mapped])
    write_rows(out / "eval.csv", ("scan", *POSE), [[f"{k}.pcd", *numbers_of(poses[k])] for k in asked])
    for k in asked:
        (out / f"{k}.pcd").unlink(missing_ok=True)
        (out / f"{k}.pcd").symlink_to((source / f"{k}.pcd").resolve())

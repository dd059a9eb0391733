"""Scans of a robot that turns on the spot: every second one makes the map, the others are asked."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from firstfix.decode import read_scan_file
from firstfix.scan.reduction import voxel_means
from firstfix.transform import Matrix, quaternion_of, transform_points
from firstfix_builder.read_map import read_trajectory

MAP_M = 25.0  # single returns further off lie apart
VOXEL_M = 0.1
HEADER = "tx,ty,tz,qx,qy,qz,qw"


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
    _write(out / "trajectory.csv", HEADER, [_numbers(poses[k]) for k in mapped])
    _write(out / "eval.csv", f"scan,{HEADER}", [[f"{k}.pcd", *_numbers(poses[k])] for k in asked])
    for k in asked:
        (out / f"{k}.pcd").symlink_to((source / f"{k}.pcd").resolve())


def _numbers(T_map_sensor: Matrix) -> list[str]:
    return [f"{value:.9f}" for value in (*T_map_sensor[:3, 3], *quaternion_of(T_map_sensor))]


def _write(path: Path, header: str, rows: Sequence[Sequence[str]]) -> None:
    path.write_text("\n".join([header, *(",".join(row) for row in rows)]) + "\n")

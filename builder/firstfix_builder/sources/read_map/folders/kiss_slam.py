"""KISS-SLAM's run (slam_output/TIME, or slam_output itself): local maps with the poses of all scans.

    local_maps/plys/000000.ply ...        the local maps, all in the frame of the poses
    NAME_poses_tum.txt, NAME_poses_kitti.txt
    occupancy_grid/occupancy_pcd.ply      with --refuse-scans: voxels of 0.5 m, levelled: another frame

kiss-slam 0.0.1 and 0.0.2 (``LocalMap.write``, ``SlamPipeline._global_mapping``).
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from firstfix.transform import inverse, transform_points

from ....mesh.level import leaning_frame
from ..map_data import MapData
from ..trajectory import read_trajectory
from ..what_was_read import LeftOut
from .joined_clouds import joined, read_clouds

_LOCAL_MAPS = "local_maps/plys"
_OCCUPANCY = "occupancy_grid/occupancy_pcd.ply"


def is_kiss_slam_run(path: Path) -> bool:
    """Whether a folder is a run of KISS-SLAM with local maps, or has the latest one."""
    return _run_in(path) is not None


def _run_in(path: Path) -> Path | None:
    runs = (path, path / "latest")
    return next((run for run in runs if any((run / _LOCAL_MAPS).glob("[!.]*.ply"))), None)


def read_kiss_slam_run(path: Path) -> MapData:
    """The local maps as one cloud, and the poses, in their frame; level, if it leans.

    Raises:
        MalformedData: a local map or the poses are damaged; the message names the file.
        TooLarge: over the limits.
    """
    path = _run_in(path) or path
    files = sorted((path / _LOCAL_MAPS).glob("[!.]*.ply"))
    data = joined(read_clouds(files))
    found = [*sorted(path.glob("[!.]*_poses_tum.txt")), *sorted(path.glob("[!.]*_poses_kitti.txt"))]
    left_out = LeftOut(_OCCUPANCY, "levelled: it is not in the frame of the poses and the local maps")
    read = replace(
        data.read,
        form="KISS-SLAM's folder",
        program="KISS-SLAM",
        unit="metre",
        clouds=tuple(file.name for file in files),
        poses=found[0].name if found else "",
    )
    read = read.without(left_out) if (path / _OCCUPANCY).is_file() else read
    return _level(replace(data, trajectory=read_trajectory(found[0]) if found else None, read=read))


def _level(data: MapData) -> MapData:
    """The map and its poses, turned level where they lean: their frame is that of the first scan."""
    T_map_level = leaning_frame(data.coordinates)
    if np.array_equal(T_map_level, np.eye(4)):
        return data
    T_level_map = inverse(T_map_level)
    lean_deg = np.degrees(np.arccos(T_map_level[2, 2]))
    note = f"it leans by {lean_deg:.0f} degrees, as its first scan did: map and poses were turned level"
    return replace(
        data,
        points=transform_points(T_level_map, data.coordinates),
        trajectory=None if data.trajectory is None else T_level_map @ data.trajectory,
        read=replace(data.read, notes=(*data.read.notes, note)),
    )

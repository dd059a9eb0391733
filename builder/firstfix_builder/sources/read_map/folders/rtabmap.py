"""RTAB-Map's export: a cloud with the poses of the run beside it.

    NAME_cloud.ply        or .las (rtabmap-export [--scan] NAME.db)
    NAME_scan_poses.txt   with --poses_scan: of the LiDAR
    NAME_poses.txt        with --poses: of the robot's base
    NAME_camera_poses.txt with --poses_camera: of the optical frame, in which z points forward

rtabmap 0.21, tools/Export/main.cpp; the endings of other formats are .g2o and .toro.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from ..map_data import MapData
from ..trajectory import read_trajectory
from ..visible_files import visible_files
from ..what_was_read import LeftOut
from .joined_clouds import read_cloud

_CLOUDS = ("_cloud.ply", "_cloud.las")
_POSES = ("_scan_poses", "_poses")  # the LiDAR's before the base's
_ENDINGS = (".txt", ".g2o")
_OF_BASE = (
    "its poses are of the robot's base, not of the LiDAR: rtabmap-export --poses_scan writes the LiDAR's"
)


def is_rtabmap_export(path: Path) -> bool:
    """Whether a folder has one exported cloud with poses of its name."""
    cloud = _cloud_in(path)
    return cloud is not None and _poses_of(cloud) is not None


def read_rtabmap_export(path: Path) -> MapData:
    """The cloud and the poses.

    Raises:
        MalformedData: one of them is damaged; the message names the file.
        TooLarge: over the limits.
    """
    cloud = _cloud_in(path)
    assert cloud is not None
    poses = _poses_of(cloud)
    assert poses is not None
    data = read_cloud(cloud)
    of_base = poses.stem == f"{_stem(cloud)}{_POSES[-1]}"
    read = replace(
        data.read,
        form="RTAB-Map's export",
        program="RTAB-Map",
        clouds=(cloud.name,),
        poses=poses.name,
        notes=(*data.read.notes, _OF_BASE) if of_base else data.read.notes,
    )
    cameras = LeftOut(
        "files of poses", "of cameras' optical frames", len(list(path.glob("[!.]*_camera_poses*.txt")))
    )
    return replace(data, trajectory=read_trajectory(poses), read=read.without(cameras))


def _stem(cloud: Path) -> str:
    return cloud.stem.removesuffix("_cloud")


def _cloud_in(path: Path) -> Path | None:
    found = [file for file in visible_files(path) if file.name.endswith(_CLOUDS)]
    return found[0] if len(found) == 1 else None


def _poses_of(cloud: Path) -> Path | None:
    names = (f"{_stem(cloud)}{kind}{ending}" for kind in _POSES for ending in _ENDINGS)
    return next((cloud.parent / name for name in names if (cloud.parent / name).is_file()), None)

"""Folders as mapping programs leave them: which files are the map, and which the poses."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firstfix.errors import UnsupportedFormat

from .file_errors import naming
from .folders.autoware import is_divided_map, read_divided_map
from .folders.hdmapping import is_hdmapping_session, read_hdmapping_session
from .folders.joined_clouds import joined, read_clouds
from .folders.kiss_slam import is_kiss_slam_run, read_kiss_slam_run
from .folders.one_frame import intervals_in, read_intervals, read_parts_of_map
from .folders.rtabmap import is_rtabmap_export, read_rtabmap_export
from .folders.unfinished import missing_part
from .glim import is_glim_dump, read_glim_dump
from .map_data import MapData
from .map_file import READERS, RECORDING_REASON, RECORDINGS, TEXTS, is_mesh_file, named_program, read_map_file
from .trajectory import read_trajectory
from .visible_files import is_hidden, visible_files
from .what_was_read import LeftOut, plain


@dataclass(frozen=True)
class FolderKind:
    """A program's folder, with a reader of its own.

    Attributes:
        program: its name.
        is_one: whether a folder is one, by the names of its files.
        read: the map in its own frame.
    """

    program: str
    is_one: Callable[[Path], bool]
    read: Callable[[Path], MapData]


# First match wins.
KINDS = (
    FolderKind("GLIM", is_glim_dump, read_glim_dump),
    FolderKind("Autoware", is_divided_map, read_divided_map),
    FolderKind("KISS-SLAM", is_kiss_slam_run, read_kiss_slam_run),
    FolderKind("HDMapping", is_hdmapping_session, read_hdmapping_session),
    FolderKind("RTAB-Map", is_rtabmap_export, read_rtabmap_export),
    FolderKind("FAST-LIO", lambda path: bool(intervals_in(path)), read_intervals),
)


@dataclass(frozen=True)
class FolderLayout:
    """A package's folder is known by any of its clouds; all that are there are merged."""

    package: str
    clouds: tuple[str, ...]


# First match wins: a whole map stands before its parts.
LAYOUTS = (
    FolderLayout("LIO-SAM", ("GlobalMap.pcd",)),
    FolderLayout("LIO-SAM", ("CornerMap.pcd", "SurfMap.pcd")),
    FolderLayout("LIO-SAM", ("cloudGlobal.pcd",)),
    FolderLayout("LIO-SAM", ("cloudCorner.pcd", "cloudSurf.pcd")),
    FolderLayout("LeGO-LOAM", ("finalCloud.pcd",)),
    FolderLayout("LeGO-LOAM", ("cornerMap.pcd", "surfaceMap.pcd")),
    FolderLayout("dddmr's LeGO-LOAM", ("map.pcd", "ground.pcd")),
    FolderLayout("Livox LOAM", ("corner.pcd", "surf.pcd")),
    FolderLayout("FAST-LIO", ("scans.pcd",)),
)
# The richest first: LIO-SAM's trajectory.pcd has no orientations, its transformations.pcd has.
TRAJECTORIES = (
    "transformations.pcd",
    "trajectory.pcd",
    "key_frame.txt",
    "optimized_poses.txt",
    "traj_lidar.txt",
    "trajectory.txt",
    "poses.txt",
    "poses.csv",
)


def read_map_folder(path: Path) -> MapData:
    """A folder to a map in its own frame.

    KINDS and LAYOUTS are known. Any other folder has one map file, or several clouds that are parts of a map.

    Raises:
        UnsupportedFormat: nothing of that.
        MalformedData, TooLarge: one of its files is damaged; the message names it.
    """
    kind = next((kind for kind in KINDS if kind.is_one(path)), None)
    if kind is not None:
        data = kind.read(path)
        return data if data.trajectory is not None else _with_poses(data, path)
    names = {file.name for file in visible_files(path)}
    layout = next((layout for layout in LAYOUTS if names & set(layout.clouds)), None)
    if layout is not None:
        files = [path / name for name in layout.clouds if name in names]
        data = joined(read_clouds(files))
        clouds = tuple(file.name for file in files)
        told = replace(data.read, form=f"{layout.package}'s folder", program=layout.package, clouds=clouds)
        told = told.without(*(LeftOut(name, _NOT_THERE) for name in layout.clouds if name not in names))
        return _with_poses(replace(data, read=told), path)
    files = _map_files(path, names)
    if len(files) > 1:
        return _with_poses(read_parts_of_map(files), path)
    with naming(files[0]):
        data = read_map_file(files[0])
    data = replace(data, read=replace(data.read, clouds=(files[0].name,)))
    return data if data.points is None or data.trajectory is not None else _with_poses(data, path)


def _with_poses(data: MapData, path: Path) -> MapData:
    """The map with the richest trajectory in its folder, if it has one."""
    name = _trajectory_name(path)
    if name is None:
        return data
    return replace(data, trajectory=read_trajectory(path / name), read=replace(data.read, poses=name))


def trajectory_in(path: Path) -> NDArray[np.float64] | None:
    """(m, 4, 4) the richest trajectory in a folder, or None if it has none."""
    name = _trajectory_name(path)
    return None if name is None else read_trajectory(path / name)


def _trajectory_name(path: Path) -> str | None:
    return next((name for name in TRAJECTORIES if (path / name).is_file()), None)


def mesh_files(path: Path) -> list[Path]:
    """The files, by name, of a folder whose maps are several meshes; nothing of any other folder."""
    files = [file for file in visible_files(path) if file.suffix.lower() in READERS]
    files = [file for file in files if file.name not in TRAJECTORIES]
    return files if len(files) > 1 and all(is_mesh_file(file) for file in files) else []


def _map_files(path: Path, names: set[str]) -> list[Path]:
    """The map files of a folder of no known program. Texts beside other clouds are poses, times and notes."""
    readable = sorted(name for name in names - set(TRAJECTORIES) if _may_be_map(name))
    clouds = [name for name in readable if Path(name).suffix.lower() not in TEXTS]
    found = [path / name for name in clouds or readable]
    lacking = "" if found else missing_part(path)
    if lacking:
        raise UnsupportedFormat(lacking)
    if len(found) == 1 or (len(found) > 1 and clouds and not any(map(is_mesh_file, found))):
        return found
    if any(Path(name).suffix.lower() in RECORDINGS for name in names):
        raise UnsupportedFormat(RECORDING_REASON)
    foreign = next((reason for name in sorted(names) if (reason := named_program(path / name))), None)
    if foreign is not None and not found:
        raise UnsupportedFormat(foreign)
    inner = sorted(plain(one.name) for one in path.iterdir() if one.is_dir() and not is_hidden(one.name))
    if inner and not found:
        told = ", ".join(inner[:_TOLD_FOLDERS]) + (" ..." if len(inner) > _TOLD_FOLDERS else "")
        raise UnsupportedFormat(f"the folder has no map file, but folders: {told}. Give the one of the map")
    known = ", ".join(dict.fromkeys(one.program for one in KINDS) | dict.fromkeys(_PACKAGES))
    raise UnsupportedFormat(
        f"the folder is of none of {known}, and has {len(found)} map files instead of one"
    )


def _may_be_map(name: str) -> bool:
    is_note = name in _NOTES or _POSES.fullmatch(name) is not None
    return Path(name).suffix.lower() in READERS and not is_note


_POSES = re.compile(r".*_poses(_tum|_kitti)?\.(npy|txt|csv)")
_NOTES = ("times.txt", "special_nodes.csv")  # SC-LIO-SAM's, hdl_graph_slam's
_PACKAGES = [layout.package for layout in LAYOUTS]
_NOT_THERE = "it belongs to the map, and is not there"
_TOLD_FOLDERS = 3

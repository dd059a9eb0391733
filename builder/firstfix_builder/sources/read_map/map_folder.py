"""Folders as SLAM packages leave them: which files are the map, and which the poses."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firstfix.errors import MalformedData, UnsupportedFormat

from .file_errors import naming
from .glim import is_glim_dump, read_glim_dump
from .map_data import MapData
from .map_file import READERS, RECORDING_REASON, RECORDINGS, is_mesh_file, read_map_file
from .trajectory import read_trajectory


@dataclass(frozen=True)
class FolderLayout:
    """A package's folder is known by any of its clouds; all that are there are merged."""

    package: str
    clouds: tuple[str, ...]


# First match wins: a whole map stands before its parts.
LAYOUTS = (
    FolderLayout("LIO-SAM", ("GlobalMap.pcd",)),
    FolderLayout("LIO-SAM", ("CornerMap.pcd", "SurfMap.pcd")),
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

    GLIM dumps and LAYOUTS are known; any other folder must hold exactly one map file.

    Raises:
        UnsupportedFormat: nothing of that.
        MalformedData, TooLarge: one of its files is damaged; the message names it.
    """
    if is_glim_dump(path):
        return read_glim_dump(path)
    names = {entry.name for entry in path.iterdir() if entry.is_file()}
    clouds = [_read(path / name) for name in _cloud_names(path, names)]
    if len(clouds) == 1 and clouds[0].points is None:
        return clouds[0]
    if any(cloud.points is None for cloud in clouds):
        raise MalformedData("it is a mesh, but a cloud is expected")
    return MapData(
        points=np.concatenate([cloud.points for cloud in clouds if cloud.points is not None]),
        trajectory=trajectory_in(path),
    )


def trajectory_in(path: Path) -> NDArray[np.float64] | None:
    """(m, 4, 4) the richest trajectory in a folder, or None if it has none."""
    name = next((name for name in TRAJECTORIES if (path / name).is_file()), None)
    return None if name is None else read_trajectory(path / name)


def mesh_files(path: Path) -> list[Path]:
    """The files, by name, of a folder whose maps are several meshes; nothing of any other folder."""
    files = sorted(file for file in path.iterdir() if file.suffix.lower() in READERS)
    files = [file for file in files if file.is_file() and file.name not in TRAJECTORIES]
    return files if len(files) > 1 and all(is_mesh_file(file) for file in files) else []


def _cloud_names(path: Path, names: set[str]) -> list[str]:
    for layout in LAYOUTS:
        present = [name for name in layout.clouds if name in names]
        if present:
            return present
    readable = sorted(name for name in names - set(TRAJECTORIES) if Path(name).suffix.lower() in READERS)
    if len(readable) == 1:
        return readable
    if any(Path(name).suffix.lower() in RECORDINGS for name in names):
        raise UnsupportedFormat(RECORDING_REASON)
    known = ", ".join(dict.fromkeys(layout.package for layout in LAYOUTS))
    raise UnsupportedFormat(
        f"the folder is neither a GLIM dump nor of {known}, and has {len(readable)} map files instead of one"
    )


def _read(path: Path) -> MapData:
    with naming(path):
        return read_map_file(path)

"""Folders of scans with their poses: our own form, and those that SLAM programs leave.

    mapping_scans/poses.csv                    ours: columns scan, tx,ty,tz,qx,qy,qz,qw (T_map_sensor)
    Scans/000000.pcd, optimized_poses.txt      SC-LIO-SAM and its kin: the row of a scan's number, as KITTI's
    000000/cloud.pcd, 000000/data, graph.g2o   hdl_graph_slam's dump: T_map_sensor below "estimate"

Those of programs are the map even where a file of features lies beside them.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from firstfix.errors import MalformedData
from firstfix.transform import Matrix

from .file_errors import naming
from .posed_scans import POSES, read_poses
from .rigid import rigid_matrices
from .trajectory import read_trajectory
from .what_was_read import plain

FOLDER = "mapping_scans"
# A scan's path from the folder, and its pose: words, the pose, or why there is none.
Row = tuple[str, Sequence[str] | Matrix]

_NUMBERED = re.compile(r"\d{1,9}")
_LAST_NUMBER = re.compile(r"\d{1,9}$")
_CLOUDS = "[!.]*.pcd"
_OPTIMIZED = "optimized_poses.txt"
_MAX_DATA_BYTES = 1 << 20


@dataclass(frozen=True)
class ScanFolder:
    """A folder of scans.

    Attributes:
        program: that left it; empty: our own form.
        folder: of the scans.
        name: of the folder in messages.
        poses: name of the files that have the poses.
        rows: reads the scans and their poses, in the order of the drive.
    """

    program: str
    folder: Path
    name: str
    poses: str
    rows: Callable[[], list[Row]]


def scan_folder_in(source: Path) -> ScanFolder | None:
    """The scans of a map's folder, by the names of its files; None: it has none."""
    if (source / FOLDER).is_dir():
        folder = source / FOLDER
        return ScanFolder("", folder, FOLDER, POSES, lambda: _of_ours(folder / POSES))
    if not source.is_dir():
        return None
    scans = source / "Scans"
    if (source / _OPTIMIZED).is_file() and scans.is_dir() and any(scans.glob(_CLOUDS)):
        return ScanFolder("SC-LIO-SAM", scans, "Scans", _OPTIMIZED, lambda: _of_sc_lio_sam(source, scans))
    if (source / "graph.g2o").is_file() and any(_hdl_keyframes(source)):
        return ScanFolder("hdl_graph_slam", source, "keyframes", "data", lambda: [*_of_hdl(source)])
    return None


def _of_ours(poses: Path) -> list[Row]:
    with naming(poses):
        return [*read_poses(poses)]


def _of_sc_lio_sam(source: Path, scans: Path) -> list[Row]:
    poses = read_trajectory(source / _OPTIMIZED)
    files = sorted((_number_of(file), file.name) for file in sorted(scans.glob(_CLOUDS)))
    twice = next((files[at][1] for at in range(1, len(files)) if files[at][0] == files[at - 1][0]), None)
    if twice is not None:
        raise MalformedData(f"two scans have the number of {plain(twice)}")
    first, last = files[0][0], files[-1][0]
    if first > 0 and last == len(poses):
        raise MalformedData(
            f"the scans are numbered {first} to {last}, and there are {last} poses: does row {first} or row "
            f"{first + 1} belong to {files[0][1]}? Number the scans from 0"
        )
    return [(name, poses[number] if number < len(poses) else ()) for number, name in files]


def _number_of(scan: Path) -> int:
    """Number at the end of a scan's name: the place in the order of names is another where one is missing."""
    found = _LAST_NUMBER.search(scan.stem)
    if found is None:
        raise MalformedData(f"{plain(scan.name)} has no number, so nothing tells which pose is its own")
    return int(found[0])


def _hdl_keyframes(source: Path) -> Iterator[Path]:
    for folder in sorted(source.iterdir()):
        if _NUMBERED.fullmatch(folder.name) and (folder / "data").is_file():
            yield folder


def _of_hdl(source: Path) -> Iterator[Row]:
    for keyframe in _hdl_keyframes(source):
        with naming(keyframe):
            yield f"{keyframe.name}/cloud.pcd", _estimate(keyframe / "data")


def _estimate(path: Path) -> Matrix:
    with naming(path):
        if path.stat().st_size > _MAX_DATA_BYTES:
            raise MalformedData(f"over {_MAX_DATA_BYTES} bytes")
        words = path.read_text("latin-1").split()
        try:
            start = words.index("estimate") + 1
            matrix = np.array([float(word) for word in words[start : start + 16]]).reshape(1, 4, 4)
        except ValueError as error:
            raise MalformedData("hdl_graph_slam: no estimate with a 4x4 matrix") from error
        T: Matrix = rigid_matrices(matrix)[0]
        return T

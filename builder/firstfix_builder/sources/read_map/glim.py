"""GLIM's dump: numbered folders of submaps, each with its cloud and its pose in the world.

``data.txt`` has ``T_world_origin:`` and a 4x4 matrix below it; ``points_compact.bin`` float32 x y z rows,
``points.bin`` (older) float64 x y z 1 rows, both in the submap's frame.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firstfix.errors import MalformedData
from firstfix.formats.raw_xyz import decode_xyz
from firstfix.transform import transform_points

from .file_errors import naming
from .map_data import MapData, finite_points
from .map_limits import LIMITS
from .rigid import rigid_matrices
from .trajectory import read_trajectory
from .what_was_read import WhatWasRead

_SUBMAP_NAME = re.compile(r"[0-9]{6,}")
_POSE_KEY = "T_world_origin:"


def is_glim_dump(path: Path) -> bool:
    """Whether a folder is a dump of GLIM."""
    return any((submap / "data.txt").is_file() for submap in _submaps(path))


def read_glim_dump(path: Path) -> MapData:
    """Read all submaps in the world frame.

    The trajectory is GLIM's optimised one (``traj_lidar.txt``) if there is one, else the submaps' origins.

    Raises:
        MalformedData: a submap is damaged or without its cloud; the message names it.
        TooLarge: over the limits.
    """
    clouds, origins, names, total = [], [], [], 0
    for submap in _submaps(path):
        with naming(submap):
            T_world_origin = _read_pose(submap / "data.txt")
            points = _read_points(submap)
            total += len(points)
            LIMITS.check("GLIM", total, 8 * 3)
            clouds.append(transform_points(T_world_origin, points))
            origins.append(T_world_origin)
            names.append(submap.name)
    optimised = path / "traj_lidar.txt"
    read = WhatWasRead(
        form="GLIM's dump",
        program="GLIM",
        unit="metre",
        clouds=tuple(names),
        poses=optimised.name if optimised.is_file() else "origins of its submaps",
    )
    return MapData(
        points=np.concatenate(clouds),
        trajectory=read_trajectory(optimised) if optimised.is_file() else np.stack(origins),
        read=read,
    )


def _submaps(path: Path) -> list[Path]:
    return sorted(entry for entry in path.iterdir() if _SUBMAP_NAME.fullmatch(entry.name) and entry.is_dir())


def _read_pose(path: Path) -> NDArray[np.float64]:
    with naming(path):
        words = path.read_text("latin-1").split()
        try:
            start = words.index(_POSE_KEY) + 1
            matrix = np.array([float(word) for word in words[start : start + 16]]).reshape(1, 4, 4)
        except ValueError as error:
            raise MalformedData(f"GLIM: no {_POSE_KEY} with a 4x4 matrix") from error
        T: NDArray[np.float64] = rigid_matrices(matrix)[0]
        return T


def _read_points(submap: Path) -> NDArray[np.float64]:
    compact, full = submap / "points_compact.bin", submap / "points.bin"
    if compact.is_file():
        with naming(compact):
            return finite_points(decode_xyz(compact.read_bytes(), LIMITS).xyz)
    with naming(full):
        raw = full.read_bytes()
        if not raw or len(raw) % 32:
            raise MalformedData(f"GLIM: {len(raw)} bytes are not rows of 32 bytes")
        return finite_points(np.frombuffer(raw, "<f8").reshape(-1, 4)[:, :3])

"""HDMapping's session: LAZ chunks in their own frames, each with a pose and the way through it.

    session.json                 "Session Settings" (offset_x ..., poses_file_name) and "laz_file_names"
    poses.reg                    number of chunks; then of each its file and the four rows of T_session_chunk
    scan_lio_0.laz ...           points in the frame of the chunk
    trajectory_lio_0.csv ...     timestamp_nanoseconds pose00 ... pose23: T_chunk_sensor

HDMapping 0.9, core/src/session.cpp and apps/lidar_odometry_step_1 (``save_result``).
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path, PureWindowsPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix.errors import MalformedData, TooLarge
from firstfix.transform import Matrix, transform_points

from ..file_errors import naming
from ..map_data import MapData
from ..map_limits import LIMITS
from ..rigid import rigid_matrices
from ..trajectory import read_trajectory
from ..what_was_read import LeftOut, plain
from .joined_clouds import joined, read_cloud

_SETTINGS, _CHUNKS = "Session Settings", "laz_file_names"
_POSES = ("poses.reg", "lio_initial_poses.reg", "session_poses.reg")
MAX_BYTES = 16 << 20  # of the session or its poses: of ten thousand chunks


def is_hdmapping_session(path: Path) -> bool:
    """Whether a folder has poses of chunks (.reg) and LAZ files."""
    return any(path.glob("[!.]*.reg")) and any(path.glob("[!.]*.la[sz]"))


def read_hdmapping_session(path: Path) -> MapData:
    """All chunks that have a pose, in the session's frame, and the way through them.

    Raises:
        MalformedData: the session, its poses or a chunk are damaged, or no chunk is there.
        TooLarge: over the limits.
    """
    settings = _settings(path)
    poses_file = _poses_file(path, settings)
    offset = _offset(settings)
    clouds, ways, names, missing = [], [], [], []
    total = 0
    for name, T_session_chunk in _poses(poses_file):
        chunk = path / name
        if not chunk.is_file():
            missing.append(name)
            continue
        data = read_cloud(chunk)
        total += len(data.coordinates)
        LIMITS.check("HDMapping", total, 8 * 3)
        points = transform_points(T_session_chunk, data.coordinates)
        clouds.append(replace(data, points=points + offset if offset.any() else points))
        ways.append(_way(chunk, T_session_chunk))
        names.append(name)
    if not clouds:
        raise MalformedData(f"none of the chunks that {poses_file.name} lists is there")
    trajectory = np.concatenate(ways)
    trajectory[:, :3, 3] += offset
    unlisted = sorted({file.name for file in path.glob("[!.]*.la[sz]")} - set(names))
    data = joined(clouds)
    read = replace(
        data.read,
        form=f"HDMapping's session, {len(names)} chunks",
        program="HDMapping",
        unit="metre",
        clouds=tuple(names),
        poses=f"{poses_file.name} with the chunks' trajectories",
    ).without(
        *(LeftOut(f"chunk {plain(name)}", "it is listed, and not there") for name in missing),
        LeftOut("chunks", f"without a pose in {poses_file.name}", len(unlisted)),
    )
    return replace(data, trajectory=trajectory, metres=(1.0, 1.0), read=read)


def _settings(path: Path) -> dict[str, Any]:
    """Settings of the session; empty if no file has them."""
    for file in sorted(path.glob("[!.]*.json")):
        with naming(file):
            try:
                told = json.loads(_bytes(file))
            except (ValueError, RecursionError) as error:
                raise MalformedData(f"no JSON: {plain(str(error))}") from None
        if isinstance(told, dict) and _CHUNKS in told and isinstance(told.get(_SETTINGS), dict):
            settings: dict[str, Any] = told[_SETTINGS]
            return settings
    return {}


def _bytes(path: Path) -> bytes:
    if path.stat().st_size > MAX_BYTES:
        raise TooLarge(f"over {MAX_BYTES} bytes")
    return path.read_bytes()


def _poses_file(path: Path, settings: dict[str, Any]) -> Path:
    """The file that the session names, by its last part: it has paths of the machine that wrote it."""
    named = PureWindowsPath(str(settings.get("poses_file_name", ""))).name
    names = [name for name in (named, *_POSES) if name and (path / name).is_file()]
    return path / names[0] if names else min(path.glob("[!.]*.reg"))


def _offset(settings: dict[str, Any]) -> NDArray[np.float64]:
    """(3,) what the session's coordinates lack to those of its export, metres."""
    try:
        offset = np.array([float(settings.get(f"offset_{axis}", 0.0)) for axis in "xyz"])
    except (TypeError, ValueError):
        raise MalformedData("the session's offset is no number") from None
    if not np.isfinite(offset).all():
        raise MalformedData("the session's offset is not finite")
    return offset


def _poses(path: Path) -> Iterator[tuple[str, Matrix]]:
    """Name of each chunk and T_session_chunk."""
    with naming(path):
        lines = [line.strip() for line in _bytes(path).decode("latin-1").splitlines() if line.strip()]
        if not lines or not lines[0].isdigit() or len(lines) < 1 + 5 * int(lines[0][:6]):
            raise MalformedData("not the number of the chunks, and five lines for each")
        for at in range(1, 1 + 5 * int(lines[0][:6]), 5):
            name = PureWindowsPath(lines[at]).name
            try:
                rows = np.array([[float(word) for word in line.split()] for line in lines[at + 1 : at + 5]])
            except ValueError:
                rows = np.empty(0)
            if rows.shape != (4, 4):
                raise MalformedData(f"{plain(name)} has no 4x4 matrix")
            yield name, rigid_matrices(rows[None])[0]


def _way(chunk: Path, T_session_chunk: Matrix) -> NDArray[np.float64]:
    """(m, 4, 4) T_session_sensor along a chunk; without a file of it the chunk's own pose."""
    number = re.search(r"(\d+)$", chunk.stem)
    csv = chunk.with_name(f"trajectory_lio_{number[1]}.csv") if number else chunk
    if number is None or not csv.is_file():
        return T_session_chunk[None].copy()
    way: NDArray[np.float64] = T_session_chunk @ read_trajectory(csv)
    return way

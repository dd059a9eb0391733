"""read_map: any map that users bring, to one form."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from firstfix.errors import InvalidOption, NotFound
from firstfix.store.sha256 import sha256_of

from .file_errors import naming
from .map_data import MapData, local_origin, scaled, subtract_origin, turn_z_up
from .map_file import read_map_file
from .map_folder import mesh_files, read_map_folder, trajectory_in
from .map_of_scans import is_map_of_scans, read_map_of_scans
from .trajectory import read_trajectory
from .visible_files import is_hidden


def content_hash(path: Path) -> str:
    """sha256 of a file; of a folder, of its files' names and hashes. Hidden files do not count."""
    if path.is_file():
        return sha256_of(path)
    digest = hashlib.sha256()
    for file in sorted(path.rglob("*")):
        name = file.relative_to(path).as_posix()
        if file.is_file() and not any(map(is_hidden, name.split("/"))):
            digest.update(f"{name}\0{sha256_of(file)}\n".encode())
    return digest.hexdigest()


Axis = Literal["z-up", "y-up"]


def read_map(
    path: Path, *, axis: Axis = "z-up", scale: float = 1.0, trajectory: Path | None = None
) -> MapData:
    """A map file, or the folder that a SLAM package left, or one of scans with their poses.

    Args:
        axis: of the source. ``y-up`` is LOAM's camera frame (x left, y up, z forward) and glTF's: the map
            and its poses are turned to REP-103.
        scale: metres in one unit of the source; 1: metres, or the unit that the source itself tells.
        trajectory: poses in the source's own frame and unit; they replace those that the source brings.

    Returns:
        float64 throughout, in a local frame when the coordinates are UTM-sized.

    Raises:
        NotFound: no such file.
        UnsupportedFormat: no reader for it.
        MalformedData, TooLarge: the data is damaged, empty, cut off or beyond the limits; the message names
            the file and the reason.
        InvalidOption: an unknown axis, or poses of an unknown unit.
    """
    path = Path(path)
    if axis not in ("z-up", "y-up"):
        raise InvalidOption(f"no axis {axis!r}; there are z-up and y-up")
    if not path.exists():
        raise NotFound(f"{path.name}: no such file")
    with naming(path):
        if is_map_of_scans(path):
            data = read_map_of_scans(path, axis, scale).data
        else:
            data = read_map_folder(path) if path.is_dir() else read_map_file(path)
    return in_local_frame(data, axis, scale, trajectory)


def in_local_frame(data: MapData, axis: Axis, scale: float, trajectory: Path | None) -> MapData:
    """The map in metres, with z up and a local origin; arguments as for ``read_map``."""
    if trajectory is not None:
        data = with_given(data, trajectory, scale)
    data = scaled(data, scale)
    if axis == "y-up":
        data = turn_z_up(data)
    return subtract_origin(data, local_origin(data))


def with_given(data: MapData, trajectory: Path, scale: float) -> MapData:
    """The map with the poses of a file that the user gave, in place of those that the source brings.

    Raises:
        InvalidOption: the map says that it is not in metres, and nobody says what the poses are in.
    """
    if scale == 1.0 and data.metres != (1.0, 1.0):
        across_m, up_m = data.metres
        remedy = f"give --scale {across_m:.10g} if they are in the same, or both files in metres"
        if across_m != up_m:  # a scale would be that of the heights, too
            remedy = "give both files in metres"
        raise InvalidOption(
            f"the map says that it is in {data.read.unit}, and the poses do not say their unit: {remedy}"
        )
    read = replace(data.read, poses=trajectory.name)
    return replace(data, trajectory=read_trajectory(trajectory), trajectory_source="given", read=read)


def read_parts(
    path: Path, *, axis: Axis = "z-up", scale: float = 1.0, trajectory: Path | None = None
) -> Iterator[MapData]:
    """A map in parts, of which one is in memory at a time: the files of a folder of meshes, by their names.

    Anything else is one part. All parts have the origin of the first, and that one has the trajectory.

    Args:
        axis, scale, trajectory: as for ``read_map``.

    Raises:
        whatever ``read_map`` raises.
    """
    files = mesh_files(path) if path.is_dir() else []
    if not files:
        yield read_map(path, axis=axis, scale=scale, trajectory=trajectory)
        return
    origin: NDArray[np.float64] | None = None
    for file in files:
        with naming(file):
            data = read_map_file(file)
        if origin is None:
            data = replace(data, trajectory=trajectory_in(path))
            data = data if trajectory is None else with_given(data, trajectory, scale)
        data = scaled(data, scale)
        if axis == "y-up":
            data = turn_z_up(data)
        if origin is None:
            origin = local_origin(data)
        yield subtract_origin(data, origin)

"""Scans with poses in a folder of a map: ``poses.csv`` names them, with T_map_sensor."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from firstfix.errors import InputError, MalformedData, NotFound
from firstfix.scan.scan import Scan
from firstfix.scan_file import read_scan_file
from firstfix.transform import Matrix

from .rigid import rigid_from_quaternions

POSES = "poses.csv"
_POSE = ("tx", "ty", "tz", "qx", "qy", "qz", "qw")


def why_not_read(axis: str, scale: float) -> str | None:
    """Reason why the scans beside a map cannot be read; None: they can, in the map's own frame and unit."""
    if axis != "z-up":
        return f"the map is {axis}, and poses of scans must be z-up"
    if scale != 1.0:
        return f"the map has a scale of {scale:g}, and scans and their poses must be in metres"
    return None


def read_poses(path: Path) -> list[tuple[str, list[str]]]:
    """Name and the seven words of the pose of each scan.

    Raises:
        MalformedData: it is no CSV text file, or lacks a column.
    """
    try:
        reader = csv.DictReader(path.read_text(encoding="utf-8-sig").splitlines(), skipinitialspace=True)
        missing = [name for name in ("scan", *_POSE) if name not in (reader.fieldnames or ())]
        if missing:
            raise MalformedData(f"the first line has no column {', '.join(missing)}")
        return [
            ((row["scan"] or "").strip(), [(row[name] or "").strip() for name in _POSE]) for row in reader
        ]
    except (UnicodeDecodeError, csv.Error) as error:
        raise MalformedData(f"not a CSV text file: {error}") from error


def pose_of(words: Sequence[str]) -> Matrix:
    """T_map_sensor of a row's seven words.

    Raises:
        ValueError: they are empty, no finite numbers, or the quaternion is not of length 1.
    """
    if not any(words):
        raise ValueError("it has no pose")
    try:
        numbers = np.array([[float(word) for word in words]])
        T: Matrix = rigid_from_quaternions(numbers[:, :3], numbers[:, 3:])[0]
    except (ValueError, MalformedData) as error:
        raise ValueError(f"it has no valid pose: {error}") from error
    return T


def read_posed_scan(folder: Path, name: str) -> Scan:
    """Read a scan that ``poses.csv`` names.

    Raises:
        ValueError: it is not in the folder, or cannot be read. The text names no folder of this machine.
    """
    path = (folder / name).resolve()
    if not name or not path.is_relative_to(folder.resolve()):
        raise ValueError("it is not in the folder")
    try:
        return read_scan_file(path)
    except (InputError, NotFound, OSError, MemoryError) as error:
        raise ValueError(str(error).replace(f"{path.parent}/", "").removeprefix(f"{path.name}: ")) from error

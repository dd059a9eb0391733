"""Reads files of poses. Name, header and number of columns show the format."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firstfix.errors import MalformedData, TooLarge
from firstfix.formats.pcd import decode_pcd
from firstfix.formats.point_cloud import MAP_LIMITS
from firstfix.formats.text_table import parse_rows

from .file_errors import naming
from .rigid import are_unit, rigid_from_angles, rigid_from_quaternions, rigid_matrices

MAX_TRAJECTORY_BYTES = 500_000_000
_CSV_COLUMNS = ("tx", "ty", "tz", "qx", "qy", "qz", "qw")


def read_trajectory(path: Path) -> NDArray[np.float64]:
    """T_map_sensor, (m, 4, 4), m >= 1, in the order of the file.

    | file | rows |
    |---|---|
    | TUM | t x y z qx qy qz qw |
    | KITTI | the 12 numbers of a 3x4 matrix, or the 16 of a 4x4 one |
    | a single pose | 3 or 4 rows of 4: the matrix itself |
    | CSV with names | tx, ty, tz, qx, qy, qz, qw among others; rows with an empty pose are left out |
    | key_frame.txt of Livox LOAM | qx qy qz qw tx ty tz |
    | pose.json (it is no JSON) | tx ty tz qw qx qy qz |
    | PCD (LIO-SAM's transformations.pcd) | x y z with roll pitch yaw; without them no turn at all |

    Raises:
        NotFound: no such file.
        MalformedData: none of these, damaged or empty; the message names the file.
        TooLarge: over 500 MB.
    """
    path = Path(path)
    with naming(path):
        size = path.stat().st_size
        if size > MAX_TRAJECTORY_BYTES:
            raise TooLarge(f"{size} bytes, the limit is {MAX_TRAJECTORY_BYTES}")
        raw = path.read_bytes()
        if not raw.strip():
            raise MalformedData("poses: the file is empty")
        if path.suffix.lower() == ".pcd":
            poses = _from_pcd(raw)
        elif _has_names(raw):
            poses = _from_csv(raw)
        else:
            poses = _from_rows(raw, path.name)
        if not len(poses):
            raise MalformedData("poses: the file has no pose")
        return poses


def _from_pcd(raw: bytes) -> NDArray[np.float64]:
    cloud = decode_pcd(raw, MAP_LIMITS)
    if {"roll", "pitch", "yaw"} <= set(cloud.columns):
        angles = np.stack([cloud.columns[name] for name in ("roll", "pitch", "yaw")], axis=1)
        return rigid_from_angles(cloud.xyz, angles.astype(np.float64))
    return rigid_from_angles(cloud.xyz, np.zeros((len(cloud), 3)))


def _has_names(raw: bytes) -> bool:
    return set(_CSV_COLUMNS) <= set(_first_line(raw).replace(" ", "").split(","))


def _first_line(raw: bytes) -> str:
    return raw.removeprefix(b"\xef\xbb\xbf").split(b"\n", 1)[0].decode("latin-1").strip()


def _from_csv(raw: bytes) -> NDArray[np.float64]:
    try:
        text = raw.decode("utf-8-sig")
        rows = list(csv.DictReader(io.StringIO(text), skipinitialspace=True))
    except (UnicodeDecodeError, csv.Error) as error:
        raise MalformedData(f"poses: {error}") from error
    poses = []
    for number, row in enumerate(rows, start=1):
        words = [(row.get(name) or "").strip() for name in _CSV_COLUMNS]
        if not any(words):
            continue  # "not in this map"
        try:
            poses.append([float(word) for word in words])
        except ValueError as error:
            raise MalformedData(f"poses: row {number}: {error}") from error
    if not poses:
        return np.empty((0, 4, 4))
    numbers = np.array(poses)
    return rigid_from_quaternions(numbers[:, :3], numbers[:, 3:])


def _from_rows(raw: bytes, file_name: str) -> NDArray[np.float64]:
    delimiter = "," if b"," in raw else None
    rows = parse_rows("poses", raw, delimiter=delimiter, comments="#")
    if not len(rows):
        return np.empty((0, 4, 4))
    columns = rows.shape[1]
    if columns in (12, 16):
        return rigid_matrices(rows.reshape(len(rows), -1, 4))
    if columns == 4 and len(rows) in (3, 4):
        return rigid_matrices(rows[None])
    if columns == 8:
        return rigid_from_quaternions(rows[:, 1:4], rows[:, 4:])
    if columns == 7 and file_name.lower() == "pose.json":
        return rigid_from_quaternions(rows[:, :3], rows[:, [4, 5, 6, 3]])
    if columns == 7 and (file_name.lower() == "key_frame.txt" or not are_unit(rows[:, 3:])):
        return rigid_from_quaternions(rows[:, 4:], rows[:, :4])
    if columns == 7:
        return rigid_from_quaternions(rows[:, :3], rows[:, 3:])
    raise MalformedData(
        f"poses: rows of {columns} numbers are neither TUM's (8), KITTI's (12) nor Livox's (7)"
    )

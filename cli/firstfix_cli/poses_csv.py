"""Reader for POSES.csv: scans and their poses."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firstfix.errors import MalformedData, NotFound
from firstfix.transform import from_quaternion

POSE_COLUMNS = ("tx", "ty", "tz", "qx", "qy", "qz", "qw")


@dataclass(frozen=True)
class PosedScan:
    """One scan and its pose.

    Attributes:
        path: path of the scan file.
        T_map_sensor: (4, 4), or None: the scan was not taken in this map.
    """

    path: Path
    T_map_sensor: NDArray[np.float64] | None


def read_poses_csv(path: Path) -> list[PosedScan]:
    """Read the columns ``scan`` (path relative to the CSV) and ``tx,ty,tz,qx,qy,qz,qw``.

    Raises:
        NotFound: no such file.
        MalformedData: a column is missing, a pose is incomplete or invalid, or there is no row.
    """
    reader = csv.DictReader(csv_lines(path), skipinitialspace=True)
    missing = [name for name in ("scan", *POSE_COLUMNS) if name not in (reader.fieldnames or ())]
    if missing:
        raise MalformedData(f"{path}: the first line has no column {', '.join(missing)}")
    rows = []
    for row in reader:
        try:
            rows.append(PosedScan(path.parent / _scan_of(row), _pose_of(row)))
        except ValueError as error:
            raise MalformedData(f"{path}, line {reader.line_num}: {error}") from None
    if not rows:
        raise MalformedData(f"{path}: the file has no scans")
    return rows


def csv_lines(path: Path) -> list[str]:
    """The lines of a CSV file, without a byte order mark.

    Raises:
        NotFound: no such file.
        MalformedData: it is no text.
    """
    try:
        return path.read_text(encoding="utf-8-sig").splitlines()
    except (FileNotFoundError, IsADirectoryError):
        raise NotFound(f"{path}: no such file") from None
    except UnicodeDecodeError:
        raise MalformedData(f"{path}: not a CSV text file") from None


def _scan_of(row: dict[str, str]) -> str:
    name = (row["scan"] or "").strip()
    if not name:
        raise ValueError("the scan has no path")
    return name


def _pose_of(row: dict[str, str]) -> NDArray[np.float64] | None:
    texts = [(row[name] or "").strip() for name in POSE_COLUMNS]
    if not any(texts):
        return None
    try:
        numbers = [float(text) for text in texts]
    except ValueError:
        raise ValueError(f"a pose must be seven numbers or empty, not {','.join(texts)}") from None
    if not np.isfinite(numbers).all():
        raise ValueError(f"the pose {','.join(texts)} is not finite")
    return from_quaternion(numbers[:3], numbers[3:])

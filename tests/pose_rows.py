"""Poses as rows of the CSV tables that ``firstfix`` commands read."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from firstfix.transform import Matrix, quaternion_of

POSE = ("tx", "ty", "tz", "qx", "qy", "qz", "qw")


def numbers_of(T_map_sensor: Matrix) -> list[str]:
    """Returns the seven cells of a pose."""
    return [f"{value:.9f}" for value in (*T_map_sensor[:3, 3], *quaternion_of(T_map_sensor))]


def write_rows(path: Path, header: Sequence[str], rows: Sequence[Sequence[str]]) -> Path:
    """Writes a table."""
    path.write_text("\n".join(",".join(row) for row in (header, *rows)) + "\n")
    return path

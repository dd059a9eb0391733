"""Scan files that data sets and programs on a desk write, and robots do not: .bin, .npy, .las, .laz, text.

The robot's own distribution leaves this module out, with all that only it needs.
"""

from __future__ import annotations

from pathlib import Path

from .confined_las import check_installed, decode_las_confined
from .las import read_las
from .npy import decode_npy, read_npy
from .point_cloud import SCAN_LIMITS, PointCloud
from .scanner_bin import decode_scanner_bin
from .text import decode_text

__all__ = [
    "check_installed",
    "decode_las_confined",
    "decode_npy",
    "decode_text",
    "read_dataset_file",
]


def read_dataset_file(path: Path, columns: tuple[str, ...] | None) -> PointCloud:
    """Read the columns of a scan's file by the ending of its name; text where it is none of the others.

    Args:
        columns: names of the columns of a .bin's rows; None: told by evidence.

    Raises:
        InputError: a subclass; the file is damaged, or too large.
        ModuleNotFoundError: laspy, which .las needs, is not installed.
    """
    suffix = path.suffix.lower()
    if suffix in (".las", ".laz"):
        return read_las(path, SCAN_LIMITS, with_times=True)
    if suffix == ".npy":
        return read_npy(path, SCAN_LIMITS)
    if suffix == ".bin":
        return decode_scanner_bin(path.read_bytes(), path.name, SCAN_LIMITS, columns)
    return decode_text(path.read_bytes(), SCAN_LIMITS)

"""What a caller has of a scan, to the bytes that are sent."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Union

from numpy.typing import ArrayLike

from firstfix import wire
from firstfix.decode import read_scan_file
from firstfix.scan import Scan

ScanLike = Union[Scan, ArrayLike, "str | os.PathLike[str]"]


def scan_of(scan: ScanLike) -> Scan:
    """
    Args:
        scan: a Scan, (n, >=3) points in metres in the sensor frame, or the path of a scan file.

    Raises:
        InvalidScan, TooLarge: the points are not a scan's.
        InputError, NotFound: the file cannot be read.
    """
    if isinstance(scan, Scan):
        return scan
    if isinstance(scan, (str, os.PathLike)):
        return read_scan_file(Path(scan))
    return Scan.from_points(scan)


def encoded(scan: ScanLike, *, resolution_m: float, voxel_m: float | None) -> bytes:
    """The body to send. Localization does not use the intensity, so it stays at home."""
    return wire.encode_scan(
        replace(scan_of(scan), intensity=None), resolution_m=resolution_m, voxel_m=voxel_m
    )

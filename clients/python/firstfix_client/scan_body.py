"""What a caller has of a scan, to the bytes that are sent."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Union

from numpy.typing import ArrayLike

from firstfix import wire, wire_sequence
from firstfix.decode import read_scan_file
from firstfix.scan import Scan
from firstfix.scan_sequence import ScanSequence

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


def encoded(
    scan: ScanLike | ScanSequence, *, resolution_m: float, voxel_m: float | None
) -> tuple[str, bytes]:
    """Media type and body to send. Localization does not use the intensity, so it stays at home."""
    if isinstance(scan, ScanSequence):
        scans = [replace(one, intensity=None) for one in scan.scans]
        return wire_sequence.MEDIA_TYPE, wire_sequence.encode_scans(
            scans, scan.T_last_scan, resolution_m=resolution_m, voxel_m=voxel_m
        )
    one = replace(scan_of(scan), intensity=None)
    return wire.MEDIA_TYPE, wire.encode_scan(one, resolution_m=resolution_m, voxel_m=voxel_m)

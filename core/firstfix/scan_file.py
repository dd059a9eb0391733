"""Reading of scans from local files, whose ending names their format."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import TypeVar

import numpy as np

from .errors import InputError, InvalidOption, MalformedData, NoSuchFile, TooLarge, UnsupportedFormat
from .formats.pcd import decode_pcd
from .formats.ply import decode_ply
from .formats.point_cloud import SCAN_LIMITS, Body, Limits, PointCloud
from .formats.point_times import point_times
from .scan.scan import Scan

MAX_SCAN_FILE_BYTES = 1_000_000_000
READABLE = (".ffscan", ".pcd", ".ply", ".bin", ".npy", ".xyz", ".txt", ".pts", ".csv", ".las", ".laz")
_CLOUD_FILES: dict[str, Callable[[Body, Limits], PointCloud]] = {".pcd": decode_pcd, ".ply": decode_ply}
_Read = TypeVar("_Read")


def read_scan_file(path: Path, columns: tuple[str, ...] | None = None) -> Scan:
    """Read a scan from a local file. The ending of the name selects the format.

    It reads .ffscan, .pcd, .ply, .bin of data sets, .npy, .xyz, .txt, .pts, .csv, and, with laspy,
    .las and .laz. For local files only: LAZ decoders are not safe for untrusted input.

    Args:
        columns: names of the columns of a .bin's rows of float32, as ``("x", "y", "z", "_", "ring")``; ``_``
            is left out. None: told by evidence.

    Raises:
        NoSuchFile: as said.
        InputError: a subclass; the message names the file.
    """
    return _named(Path(path), partial(_read_scan_file, columns=columns))


def read_cloud_file(path: Path, columns: tuple[str, ...] | None = None) -> PointCloud:
    """Read the columns of a scan's file, all that the format has: beams, too. As ``read_scan_file`` does.

    Raises:
        NoSuchFile, InputError: as there.
    """
    return _named(Path(path), partial(_read_cloud_file, columns=columns))


def _named(path: Path, read: Callable[[Path], _Read]) -> _Read:
    """Read a file; an error names it."""
    try:
        return read(path)
    except InputError as error:
        raise type(error)(f"{path}: {error}") from error
    except FileNotFoundError as error:
        raise NoSuchFile(f"{path}: no such file") from error


def _read_scan_file(path: Path, columns: tuple[str, ...] | None) -> Scan:
    if path.suffix.lower() == ".ffscan":
        _check_file(path)
        return _of_wire(path.read_bytes())
    return scan_of_cloud(_read_cloud_file(path, columns))


def _read_cloud_file(path: Path, columns: tuple[str, ...] | None) -> PointCloud:
    suffix = _check_file(path)
    if columns is not None and suffix != ".bin":
        raise InvalidOption("columns are for .bin: the other formats say theirs")
    if suffix == ".ffscan":
        points = _of_wire(path.read_bytes()).points
        return PointCloud(dict(zip("xyz", points.T, strict=True)))
    if suffix in _CLOUD_FILES:
        return _CLOUD_FILES[suffix](path.read_bytes(), SCAN_LIMITS)
    return dataset_files_of(suffix).read_dataset_file(path, columns)


def _check_file(path: Path) -> str:
    """The ending of a scan's file."""
    suffix, size = path.suffix.lower(), path.stat().st_size  # one that is not there is not of an unknown kind
    if path.is_dir():
        raise UnsupportedFormat("this is a folder, not the file of a scan")
    if suffix not in READABLE:
        ending = f"that end in {suffix!r}" if suffix else "without an ending"
        raise UnsupportedFormat(f"scans cannot be read from files {ending}: use {', '.join(READABLE)}")
    if size > MAX_SCAN_FILE_BYTES:
        raise TooLarge(f"{size} bytes, the limit is {MAX_SCAN_FILE_BYTES}")
    if size == 0:
        raise MalformedData("the file is empty (0 bytes)")
    return suffix


def _of_wire(body: Body) -> Scan:
    from .wire import scan as wire  # imported late: the other readers do not need zstandard

    return wire.decode_scan(body)


def scan_of_cloud(cloud: PointCloud) -> Scan:
    """Make a scan of a file's columns, with the times of its points.

    Raises:
        InvalidScan, TooLarge: as ``Scan.from_columns``.
    """
    with np.errstate(invalid="ignore", over="ignore"):  # an intensity may be any float32
        columns = cloud.columns
        times = point_times(columns, None)
        x, y, z = columns["x"], columns["y"], columns["z"]
        return Scan.from_columns(x, y, z, cloud.intensity, times.stamp_s, times.time_s, times.field)


def dataset_files_of(what: str) -> ModuleType:
    """The module of formats that the robot's distribution leaves out.

    Args:
        what: is to be read, for the error.

    Raises:
        UnsupportedFormat: it is left out.
    """
    try:
        from .formats import dataset_files
    except ImportError as error:
        raise UnsupportedFormat(
            "the robot's client reads .ffscan, .pcd and .ply files, and arrays: install firstfix itself for "
            f"{what}"
        ) from error
    return dataset_files

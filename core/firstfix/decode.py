"""Decoding of request bodies and files to scans: one table of media types and decoders."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np

from .errors import InputError, InvalidOption, MalformedData, NotFound, TooLarge, UnsupportedFormat
from .formats.npy import read_npy
from .formats.pcd import decode_pcd
from .formats.ply import decode_ply
from .formats.point_cloud import SCAN_LIMITS, Body, Limits, PointCloud
from .formats.point_times import point_times
from .formats.raw_xyz import decode_rows, decode_xyz, decode_xyzi, parse_columns
from .formats.scanner_bin import decode_scanner_bin
from .formats.text import decode_text
from .ros.media_types import CDR, ZENOH_CDR, check_cloud_type
from .ros.point_cloud2 import decode_point_cloud2
from .scan.scan import Scan
from .scan.sequence import AnyScan, ScanSequence

__all__ = [
    "MEDIA_TYPES",
    "SCAN_FORMATS",
    "SUFFIXES",
    "decode_query",
    "decoder_of",
    "is_point_cloud2",
    "read_cloud_file",
    "read_scan_file",
    "scan_of_cloud",
]

MAX_SCAN_FILE_BYTES = 1_000_000_000
ROWS = "application/vnd.firstfix.xyzi"


def _decode_wire(body: Body) -> Scan:
    from .wire import scan as wire  # imported late: the other decoders do not need zstandard

    return wire.decode_scan(body)


def _decode_sequence(body: Body) -> ScanSequence:
    from .wire import sequence as wire_sequence

    return wire_sequence.decode_scans(body)


def _decode_compact(body: Body) -> AnyScan:
    from .wire import query as wire_query

    return wire_query.decode_query(body)


def _decode_cdr(body: Body) -> Scan:
    return decode_point_cloud2(body, SCAN_LIMITS).scan()


def _decode_cloud(decode: Callable[[Body, Limits], PointCloud], body: Body) -> Scan:
    return scan_of_cloud(decode(body, SCAN_LIMITS))


def _decode_rows(columns: tuple[str, ...], body: Body) -> Scan:
    return scan_of_cloud(decode_rows(body, columns, SCAN_LIMITS))


def _by(decode: Callable[[Body, Limits], PointCloud]) -> Callable[[Body], Scan]:
    return partial(_decode_cloud, decode)


def scan_of_cloud(cloud: PointCloud) -> Scan:
    """Make a scan of a file's columns, with the times of its points.

    Raises:
        InvalidScan, TooLarge: as ``Scan.from_columns``.
    """
    with np.errstate(invalid="ignore", over="ignore"):  # an intensity may be any float32
        x, y, z = (cloud.columns[axis] for axis in "xyz")
        times = point_times(cloud.columns, None)
        return Scan.from_columns(x, y, z, cloud.intensity, times.stamp_s, times.time_s, times.field)


@dataclass(frozen=True)
class ScanFormat:
    """A format of scans.

    Attributes:
        media_types: the first is the one to send; the others mean the same.
        encoding: the format in the words of clients/PROTOCOL.md.
        decode: makes a scan of a body. It can be pickled.
        suffix: ending of files that can be sent without change.
    """

    media_types: tuple[str, ...]
    encoding: str
    decode: Callable[[Body], AnyScan]
    suffix: str | None = None


# What is told elsewhere is made from these rows: `python scripts/generate.py`.
SCAN_FORMATS = (
    ScanFormat(
        ("application/vnd.firstfix.scan",),
        "compressed, as points or as a [range image](protocol/range-image.md): [scan.md](protocol/scan.md)",
        _decode_wire,
        ".ffscan",
    ),
    ScanFormat(("application/vnd.firstfix.xyz",), "raw little-endian float32, n x 3", _by(decode_xyz)),
    ScanFormat(
        (ROWS,),
        "raw little-endian float32, n x 4, the fourth is the intensity; or n x m, with the columns' names: "
        '`application/vnd.firstfix.xyzi; columns="x,y,z,intensity,ring,time"`',
        _by(decode_xyzi),
        ".bin",
    ),
    ScanFormat(("application/x-pcd", "model/vnd.pcd"), "PCD", _by(decode_pcd), ".pcd"),
    ScanFormat(("application/ply", "model/ply"), "PLY", _by(decode_ply), ".ply"),
    ScanFormat((CDR, ZENOH_CDR), "a ROS 2 message `sensor_msgs/msg/PointCloud2` as CDR", _decode_cdr),
    ScanFormat(
        ("application/vnd.firstfix.query",),
        "a compact query, under 10 KB: some thousand points and the range view; or a descriptor alone, "
        "under 1.5 KB: [query.md](protocol/query.md)",
        _decode_compact,
    ),
    ScanFormat(
        ("application/vnd.firstfix.scans",),
        "several scans with the robot's motion between them: [scan.md](protocol/scan.md)",
        _decode_sequence,
    ),
)
MEDIA_TYPES = {name: each.decode for each in SCAN_FORMATS for name in each.media_types}
SUFFIXES = {each.suffix: each.media_types[0] for each in SCAN_FORMATS if each.suffix}
READABLE = (*SUFFIXES, ".npy", ".xyz", ".txt", ".pts", ".csv", ".las", ".laz")
_CLOUD_FILES: dict[str, Callable[[Body, Limits], PointCloud]] = {".pcd": decode_pcd, ".ply": decode_ply}
_Read = TypeVar("_Read")


def decode_query(body: Body, media_type: str) -> AnyScan:
    """The scan in a request body. Safe with bytes from strangers.

    Raises:
        UnsupportedFormat: as ``decoder_of``.
        MalformedData, TooLarge, InvalidScan: as the decoder says.
    """
    return decoder_of(media_type)(body)


def decoder_of(media_type: str) -> Callable[[Body], AnyScan]:
    """The decoder of a media type. It can be pickled.

    Args:
        media_type: one of MEDIA_TYPES, in any case. Parameters after a semicolon are ignored, except the
            message type of CDR, and the columns of raw rows.

    Raises:
        UnsupportedFormat: unknown media type, or a ROS message that is not a PointCloud2.
        InvalidOption: columns that are none.
    """
    name = media_type.split(";", 1)[0].strip().lower()
    decoder = MEDIA_TYPES.get(name)
    if decoder is None:
        raise UnsupportedFormat(
            f"unknown media type {name[:80]!r} of a scan: use one of {', '.join(MEDIA_TYPES)}"
        )
    if decoder is _decode_cdr:
        check_cloud_type(media_type)
    columns = _columns_of(media_type) if name == ROWS else None
    return decoder if columns is None else partial(_decode_rows, columns)


def _columns_of(media_type: str) -> tuple[str, ...] | None:
    for parameter in media_type.split(";")[1:]:
        key, _, value = parameter.partition("=")
        if key.strip().lower() == "columns":
            return parse_columns(value.strip().strip('"'))
    return None


def is_point_cloud2(decoder: Callable[[Body], AnyScan]) -> bool:
    """Whether a decoder of ``decoder_of`` reads PointCloud2 messages."""
    return decoder is _decode_cdr


def read_scan_file(path: Path, columns: tuple[str, ...] | None = None) -> Scan:
    """Read a scan from a local file. The ending of the name selects the format.

    It reads the endings of SUFFIXES, .bin of data sets, .npy, .xyz, .txt, .pts, .csv, and, with laspy,
    .las and .laz. For local files only: LAZ decoders are not safe for untrusted input.

    Args:
        columns: names of the columns of a .bin's rows of float32, as ``("x", "y", "z", "_", "ring")``; ``_``
            is left out. None: told by evidence.

    Raises:
        NotFound: no such file.
        InputError: a subclass; the message names the file.
    """
    return _named(Path(path), partial(_read_scan_file, columns=columns))


def read_cloud_file(path: Path, columns: tuple[str, ...] | None = None) -> PointCloud:
    """Read the columns of a scan's file, all that the format has: beams, too. As ``read_scan_file`` does.

    Raises:
        NotFound, InputError: as there.
    """
    return _named(Path(path), partial(_read_cloud_file, columns=columns))


def _named(path: Path, read: Callable[[Path], _Read]) -> _Read:
    """Read a file; an error names it."""
    try:
        return read(path)
    except InputError as error:
        raise type(error)(f"{path}: {error}") from error
    except FileNotFoundError as error:
        raise NotFound(f"{path}: no such file") from error


def _read_scan_file(path: Path, columns: tuple[str, ...] | None) -> Scan:
    if path.suffix.lower() == ".ffscan":
        _check_file(path)
        return _decode_wire(path.read_bytes())
    return scan_of_cloud(_read_cloud_file(path, columns))


def _read_cloud_file(path: Path, columns: tuple[str, ...] | None) -> PointCloud:
    suffix = _check_file(path)
    if columns is not None and suffix != ".bin":
        raise InvalidOption("columns are for .bin: the other formats say theirs")
    if suffix == ".ffscan":
        points = _decode_wire(path.read_bytes()).points
        return PointCloud(dict(zip("xyz", points.T, strict=True)))
    if suffix == ".npy":
        return read_npy(path, SCAN_LIMITS)
    if suffix in (".las", ".laz"):
        return _read_las(path)
    if suffix == ".bin":
        return decode_scanner_bin(path.read_bytes(), path.name, SCAN_LIMITS, columns)
    if suffix in _CLOUD_FILES:
        return _CLOUD_FILES[suffix](path.read_bytes(), SCAN_LIMITS)
    return decode_text(path.read_bytes(), SCAN_LIMITS)


def _check_file(path: Path) -> str:
    """The ending of a scan's file."""
    suffix = path.suffix.lower()
    if path.is_dir():
        raise UnsupportedFormat("this is a folder, not the file of a scan")
    if suffix not in READABLE:
        ending = f"that end in {suffix!r}" if suffix else "without an ending"
        raise UnsupportedFormat(f"scans cannot be read from files {ending}: use {', '.join(READABLE)}")
    size = path.stat().st_size
    if size > MAX_SCAN_FILE_BYTES:
        raise TooLarge(f"{size} bytes, the limit is {MAX_SCAN_FILE_BYTES}")
    if size == 0:
        raise MalformedData("the file is empty (0 bytes)")
    return suffix


def _read_las(path: Path) -> PointCloud:
    from .formats.las import read_las

    return read_las(path, SCAN_LIMITS, with_times=True)

"""Decoding of request bodies and files to scans: one table of media types and decoders."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from .errors import InputError, MalformedData, NotFound, TooLarge, UnsupportedFormat
from .formats.npy import read_npy
from .formats.pcd import decode_pcd
from .formats.ply import decode_ply
from .formats.point_cloud import SCAN_LIMITS, Body, Limits, PointCloud, point_times
from .formats.raw_xyz import decode_xyz, decode_xyzi
from .formats.scanner_bin import decode_scanner_bin
from .formats.text import decode_text
from .ros.media_types import CDR, ZENOH_CDR, check_cloud_type
from .ros.point_cloud2 import decode_point_cloud2
from .scan.scan import Scan
from .scan.sequence import AnyScan, ScanSequence

__all__ = [
    "MEDIA_TYPES",
    "SUFFIXES",
    "decode_query",
    "decoder_of",
    "is_point_cloud2",
    "read_scan_file",
]

MAX_SCAN_FILE_BYTES = 1_000_000_000


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
    return _scan_of(decode(body, SCAN_LIMITS))


def _by(decode: Callable[[Body, Limits], PointCloud]) -> Callable[[Body], Scan]:
    return partial(_decode_cloud, decode)


def _scan_of(cloud: PointCloud) -> Scan:
    with np.errstate(invalid="ignore", over="ignore"):  # an intensity may be any float32
        x, y, z = (cloud.columns[axis] for axis in "xyz")
        times = point_times(cloud.columns, None)
        if times is None:
            return Scan.from_columns(x, y, z, cloud.intensity)
        return Scan.from_columns(x, y, z, cloud.intensity, times.stamp_s, times.time_s)


_SCAN_TYPES: dict[str, Callable[[Body], Scan]] = {
    "application/vnd.firstfix.scan": _decode_wire,
    "application/vnd.firstfix.xyz": _by(decode_xyz),
    "application/vnd.firstfix.xyzi": _by(decode_xyzi),
    "application/x-pcd": _by(decode_pcd),
    "model/vnd.pcd": _by(decode_pcd),
    "application/ply": _by(decode_ply),
    "model/ply": _by(decode_ply),
    CDR: _decode_cdr,
    ZENOH_CDR: _decode_cdr,
}
MEDIA_TYPES: dict[str, Callable[[Body], AnyScan]] = {
    **_SCAN_TYPES,
    "application/vnd.firstfix.query": _decode_compact,
    "application/vnd.firstfix.scans": _decode_sequence,
}
# File endings of files that can be sent without change.
SUFFIXES: dict[str, str] = {
    ".ffscan": "application/vnd.firstfix.scan",
    ".bin": "application/vnd.firstfix.xyzi",
    ".pcd": "application/x-pcd",
    ".ply": "application/ply",
}


def decode_query(body: Body, media_type: str) -> AnyScan:
    """Returns the scan in a request body. Safe with bytes from strangers.

    Raises:
        UnsupportedFormat: as ``decoder_of``.
        MalformedData, TooLarge, InvalidScan: as the decoder says.
    """
    return decoder_of(media_type)(body)


def decoder_of(media_type: str) -> Callable[[Body], AnyScan]:
    """Returns the decoder of a media type. It can be pickled.

    Args:
        media_type: one of MEDIA_TYPES, in any case. Parameters after a semicolon are ignored, except the
            message type of CDR.

    Raises:
        UnsupportedFormat: unknown media type, or a ROS message that is not a PointCloud2.
    """
    name = media_type.split(";", 1)[0].strip().lower()
    decoder = MEDIA_TYPES.get(name)
    if decoder is None:
        raise UnsupportedFormat(
            f"unknown media type {name[:80]!r} of a scan: use one of {', '.join(MEDIA_TYPES)}"
        )
    if decoder is _decode_cdr:
        check_cloud_type(media_type)
    return decoder


def is_point_cloud2(decoder: Callable[[Body], AnyScan]) -> bool:
    """Returns whether a decoder of ``decoder_of`` reads PointCloud2 messages."""
    return decoder is _decode_cdr


def read_scan_file(path: Path) -> Scan:
    """Reads a scan from a local file. The ending of the name selects the format.

    It reads the endings of SUFFIXES, .bin of NCLT and HeLiPR, .npy, .xyz, .txt, .pts, .csv, and, with laspy,
    .las and .laz. For local files only: LAZ decoders are not safe for untrusted input.

    Raises:
        NotFound: no such file.
        InputError: a subclass; the message names the file.
    """
    path = Path(path)
    try:
        return _read_scan_file(path)
    except InputError as error:
        raise type(error)(f"{path}: {error}") from error
    except (FileNotFoundError, IsADirectoryError) as error:
        raise NotFound(f"{path}: no such file") from error


def _read_scan_file(path: Path) -> Scan:
    suffix = path.suffix.lower()
    if suffix not in (*SUFFIXES, ".npy", ".xyz", ".txt", ".pts", ".csv", ".las", ".laz"):
        raise UnsupportedFormat(f"scans cannot be read from files that end in {suffix!r}")
    size = path.stat().st_size
    if size > MAX_SCAN_FILE_BYTES:
        raise TooLarge(f"{size} bytes, the limit is {MAX_SCAN_FILE_BYTES}")
    if size == 0:
        raise MalformedData("the file is empty (0 bytes)")
    if suffix == ".npy":
        return _scan_of(read_npy(path, SCAN_LIMITS))
    if suffix in (".las", ".laz"):
        return _read_las(path)
    if suffix == ".bin":
        return _scan_of(decode_scanner_bin(path.read_bytes(), path.name, SCAN_LIMITS))
    if suffix in SUFFIXES:
        return _SCAN_TYPES[SUFFIXES[suffix]](path.read_bytes())
    return _scan_of(decode_text(path.read_bytes(), SCAN_LIMITS))


def _read_las(path: Path) -> Scan:
    from .formats.las import read_las

    return _scan_of(read_las(path, SCAN_LIMITS, with_times=True))

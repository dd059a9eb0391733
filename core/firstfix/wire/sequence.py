"""The encoding ``application/vnd.firstfix.scans``: several scans with the sensor's poses.

Layout, little-endian::

    offset  type   field
         0  4 s    magic "FFSS"
         4  u8     version, 1
         5  u8     scan count n, 1 to firstfix.scan.sequence.MAX_SCANS
         6  u16    0

then n times, in the order in which the scans were taken::

         0  7 f64  T_odom_sensor: position x, y, z in metres, quaternion x, y, z, w
        56  u32    length of the scan
        60  bytes  the scan: application/vnd.firstfix.scan, or application/vnd.firstfix.query with
                   points; its first four bytes tell which
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .. import transform
from ..errors import InvalidScan, MalformedData, TooLarge, UnsupportedFormat
from ..scan.compact import CompactScan
from ..scan.scan import MAX_POINTS, Scan
from ..scan.sequence import MAX_SCANS, ScanSequence
from . import query as wire_query
from . import scan as wire

MEDIA_TYPE = "application/vnd.firstfix.scans"
MAGIC = b"FFSS"
VERSION = 1

_HEADER = struct.Struct("<4sBBH")
_ENTRY = struct.Struct("<7dI")


def encode_scans(
    scans: Sequence[Scan | CompactScan],
    T_odom_sensor: Sequence[NDArray[np.floating]],
    *,
    form: wire.ScanForm = "points",
    resolution_m: float | None = None,
    voxel_m: float | None = None,
) -> bytes:
    """Encode scans in the order in which they were taken, with the sensor's poses from odometry.

    Raises:
        InvalidScan, TooLarge: as ``ScanSequence.along`` and the encoders of one scan.
        InvalidOption: as ``wire.scan.encode_scan``, for scans that are not compact.
    """
    poses = [np.asarray(T, np.float64) for T in T_odom_sensor]
    ScanSequence.along(scans, poses)
    parts = [_HEADER.pack(MAGIC, VERSION, len(scans), 0)]
    for scan, T in zip(scans, poses, strict=True):
        if isinstance(scan, CompactScan):
            body = wire_query.encode_query(scan)
        else:
            body = wire.encode_scan(scan, form=form, resolution_m=resolution_m, voxel_m=voxel_m)
        parts += [_ENTRY.pack(*T[:3, 3], *transform.quaternion_of(T), len(body)), body]
    return b"".join(parts)


def decode_scans(body: bytes | memoryview) -> ScanSequence:
    """Decode a sequence. Every size is checked before memory is allocated.

    Raises:
        MalformedData: not this format, or the bytes contradict their headers.
        UnsupportedFormat: a later version.
        TooLarge: too many scans or points.
        InvalidScan: a pose is not valid.
    """
    if len(body) < _HEADER.size:
        raise MalformedData(f"{len(body)} bytes are too few for a {MEDIA_TYPE} header of {_HEADER.size}")
    magic, version, count, zero = _HEADER.unpack_from(body)
    if magic != MAGIC or zero:
        raise MalformedData(f"not {MEDIA_TYPE}: it begins with {bytes(body[: _HEADER.size])!r}")
    if version != VERSION:
        raise UnsupportedFormat(f"{MEDIA_TYPE} version {version}: only version {VERSION} is supported")
    if count > MAX_SCANS:
        raise TooLarge(f"a sequence has at most {MAX_SCANS} scans, not {count}")
    scans, poses, points, at = [], [], 0, _HEADER.size
    for number in range(count):
        if len(body) - at < _ENTRY.size:
            raise MalformedData(f"the bytes end in scan {number} of {count}")
        *seven, length = _ENTRY.unpack_from(body, at)
        at += _ENTRY.size
        if len(body) - at < length:
            raise MalformedData(f"scan {number} has {len(body) - at} bytes, its header says {length}")
        scan = _decode_one(body[at : at + length], number)
        points += len(scan)
        if points > MAX_POINTS:
            raise TooLarge(f"the scans together have over {MAX_POINTS} points")
        scans.append(scan)
        poses.append(_pose(seven, number))
        at += length
    if at != len(body):
        raise MalformedData(f"{len(body) - at} bytes follow the last scan")
    return ScanSequence.along(scans, poses)


def _decode_one(body: bytes | memoryview, number: int) -> Scan | CompactScan:
    if bytes(body[: len(wire_query.MAGIC)]) != wire_query.MAGIC:
        return wire.decode_scan(body)
    scan = wire_query.decode_query(body)
    if not isinstance(scan, CompactScan):
        raise MalformedData(f"scan {number} of the sequence is a descriptor without points")
    return scan


def _pose(seven: list[float], number: int) -> NDArray[np.float64]:
    try:
        return transform.from_quaternion(seven[:3], seven[3:])
    except ValueError as error:
        raise InvalidScan(f"pose {number} of the sequence: {error}") from None

"""The counts in a LAS or LAZ file, compared with the file's size before a library believes them.

laspy makes as many records as a header says.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from ..errors import MalformedData
from .point_cloud import Limits

_HEADER_BYTES = 227  # of LAS 1.1 and 1.2; 1.4 counts its points further behind
_LARGE_COUNT_AT = 247
_VLR_HEADER = struct.Struct("<2x16sHH32x")
_EVLR_HEADER = struct.Struct("<2x16sHQ32x")
_MAX_VLRS = 10_000
_WKT_BIT = 0x10  # of the global encoding
_COMPRESSED = 0x80  # bit of the point format
_LASZIP = b"laszip encoded", 22204


@dataclass(frozen=True)
class LasRecord:
    """A variable length record: whose it is, its number, and the place and size of its data."""

    user: bytes
    kind: int
    place: int
    size: int


@dataclass(frozen=True)
class LasHeader:
    """Declarations of a file's header, all of them within the file.

    Attributes:
        size: of the file, in bytes.
        start: place of the first point.
        points, point_bytes: their number, and the size of one, unpacked.
        records: those before the points, and those behind them.
        version: as "1.4".
        program: that wrote the file.
        has_wkt: the coordinate system is told as well-known text, and not by GeoTIFF's keys.
        packing: record of the compression; None: there is none.
    """

    size: int
    start: int
    points: int
    point_bytes: int
    records: tuple[LasRecord, ...]
    version: str
    program: str
    has_wkt: bool
    packing: bytes | None = None


def read_las_header(path: Path, limits: Limits, column_bytes: int) -> LasHeader:
    """Read and check all counts of a file that a reader takes memory for.

    Args:
        column_bytes: of one point, as it is returned.

    Raises:
        MalformedData: a count is larger than the file has room for.
        TooLarge: more points than the limits allow.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(_LARGE_COUNT_AT + 8)
        if not head.startswith(b"LASF"):
            raise MalformedData("LAS: the file does not start with 'LASF'")
        if len(head) < _HEADER_BYTES:
            raise MalformedData(f"LAS: the file is cut off: {len(head)} bytes of a header")
        header_bytes, start, vlrs, point_format, point_bytes, points = struct.unpack_from("<HIIBHI", head, 94)
        if head[25] >= 4:
            if len(head) < _LARGE_COUNT_AT + 8:
                raise MalformedData(f"LAS: the file is cut off: {len(head)} bytes of a header")
            (points,) = struct.unpack_from("<Q", head, _LARGE_COUNT_AT)
        if not header_bytes <= start <= size:
            raise MalformedData(f"LAS: the file is cut off: its points start at byte {start} of {size}")
        limits.check("LAS", points, column_bytes)
        if point_bytes == 0:
            raise MalformedData("LAS: a point has 0 bytes")
        records = tuple(_records(file, header_bytes, start, vlrs))
        told: dict[str, Any] = {
            "records": (*records, *_records_behind(file, head, size)),
            "version": f"{head[24]}.{head[25]}",
            "program": head[58:90].partition(b"\0")[0].decode("latin-1").strip(),
            "has_wkt": bool(head[6] & _WKT_BIT),
        }
        if not point_format & _COMPRESSED:
            if points * point_bytes > size - start:
                raise MalformedData(
                    f"LAS: the file is cut off: {size - start} of {points * point_bytes} bytes for {points} "
                    f"points of {point_bytes} bytes"
                )
            return LasHeader(size, start, points, point_bytes, **told)
        packing = next((one for one in records if (one.user, one.kind) == _LASZIP), None)
        if packing is None:
            raise MalformedData("LAS: the points are compressed, and no record says how")
        file.seek(packing.place)
        return LasHeader(size, start, points, point_bytes, packing=file.read(packing.size), **told)


def _records(file: BinaryIO, first: int, start: int, count: int) -> Iterator[LasRecord]:
    """Follow the records before the points."""
    if count > min(_MAX_VLRS, (start - first) // _VLR_HEADER.size):
        raise MalformedData(f"LAS: {start - first} bytes cannot hold {count} variable length records")
    at = first
    for number in range(count):
        file.seek(at)
        head = file.read(_VLR_HEADER.size)
        at += len(head)
        if len(head) < _VLR_HEADER.size or at > start:
            raise MalformedData(f"LAS: the variable length record {number} is cut off")
        user, kind, length = _VLR_HEADER.unpack(head)
        if at + length > start:
            raise MalformedData(f"LAS: the variable length record {number} reaches into the points")
        yield LasRecord(user.partition(b"\0")[0], kind, at, length)
        at += length


def _records_behind(file: BinaryIO, head: bytes, size: int) -> Iterator[LasRecord]:
    """Follow the records behind the points (LAS 1.4). No reader needs them: those that do not fit end it."""
    if head[25] < 4 or len(head) < _LARGE_COUNT_AT:
        return
    at, count = struct.unpack_from("<QI", head, _LARGE_COUNT_AT - 12)
    for _ in range(min(count, _MAX_VLRS)):
        if not 0 < at <= size - _EVLR_HEADER.size:
            return
        file.seek(at)
        user, kind, length = _EVLR_HEADER.unpack(file.read(_EVLR_HEADER.size))
        at += _EVLR_HEADER.size
        if length > size - at:
            return
        yield LasRecord(user.partition(b"\0")[0], kind, at, length)
        at += length

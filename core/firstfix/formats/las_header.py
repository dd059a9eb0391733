"""The counts in a LAS or LAZ file, compared with the file's size before a library believes them.

laspy makes as many records as a header says.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from ..errors import MalformedData
from .point_cloud import Limits

_HEADER_BYTES = 227  # of LAS 1.1 and 1.2; 1.4 counts its points further behind
_LARGE_COUNT_AT = 247
_VLR_HEADER = struct.Struct("<2x16sHH32x")
_MAX_VLRS = 10_000
_COMPRESSED = 0x80  # bit of the point format
_LASZIP = b"laszip encoded", 22204


@dataclass(frozen=True)
class LasHeader:
    """Declarations of a file's header, all of them within the file.

    Attributes:
        size: of the file, in bytes.
        start: place of the first point.
        points, point_bytes: their number, and the size of one, unpacked.
        packing: record of the compression; None: there is none.
    """

    size: int
    start: int
    points: int
    point_bytes: int
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
        record = _laszip_record(file, header_bytes, start, vlrs)
        if not point_format & _COMPRESSED:
            if points * point_bytes > size - start:
                raise MalformedData(
                    f"LAS: the file is cut off: {size - start} of {points * point_bytes} bytes for {points} "
                    f"points of {point_bytes} bytes"
                )
            return LasHeader(size, start, points, point_bytes)
        if record is None:
            raise MalformedData("LAS: the points are compressed, and no record says how")
        return LasHeader(size, start, points, point_bytes, record)


def _laszip_record(file: BinaryIO, first: int, start: int, count: int) -> bytes | None:
    """Follow the records before the points. Returns that of the compression, or None."""
    if count > min(_MAX_VLRS, (start - first) // _VLR_HEADER.size):
        raise MalformedData(f"LAS: {start - first} bytes cannot hold {count} variable length records")
    found = None
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
        if found is None and (user.partition(b"\0")[0], kind) == _LASZIP:
            found = file.read(length)
        at += length
    return found

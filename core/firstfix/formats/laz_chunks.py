"""The tables of a LAZ file, compared with its size before lazrs takes as much memory as they say."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from ..errors import MalformedData
from .las_header import LasHeader, read_las_header
from .point_cloud import Limits

_LASZIP_HEADER = struct.Struct("<HH8xI16xH")  # compressor, coder, points a chunk, items
_ITEM = struct.Struct("<HHH")  # type, bytes, version
_POINTWISE, _CHUNKED, _LAYERED = 1, 2, 3  # compressors
_VARIABLE = 0xFFFFFFFF  # points a chunk
# Numbers of layers by the type of an item; an item of extra bytes has one for each.
_LAYERS = {10: 9, 11: 1, 12: 2, 13: 1}
_EXTRA_BYTES = 14
_MAX_CHUNKS = 1_000_000
_MAX_POINTS_PER_BYTE = 1000  # a million copies of one point take more
_SPARE_POINTS = 10_000_000  # of the last chunk, which lazrs takes memory for


@dataclass(frozen=True)
class _Packing:
    compressor: int
    chunk_points: int
    layers: int  # of a chunk; 0: a chunk has none
    record: bytes


def check_las(path: Path, limits: Limits, column_bytes: int) -> LasHeader:
    """Check all counts in a file that laspy or lazrs believe: of records, points, chunks and layers.

    Args:
        column_bytes: of one point, as it is returned.

    Returns:
        The header, all of whose counts are true.

    Raises:
        MalformedData: a count is larger than the file has room for.
        TooLarge: more points than the limits allow.
    """
    header = read_las_header(path, limits, column_bytes)
    if header.packing is None:
        return header
    size, start, points = header.size, header.start, header.points
    if points > _MAX_POINTS_PER_BYTE * (size - start):
        raise MalformedData(f"LAS: {size - start} compressed bytes cannot hold {points} points")
    packing = _packing(header.packing, header.point_bytes)
    if points:
        with path.open("rb") as file:
            _check_chunks(file, start, size, points, header.point_bytes, packing)
    return header


def _packing(record: bytes, point_bytes: int) -> _Packing:
    try:
        compressor, coder, chunk_points, count = _LASZIP_HEADER.unpack_from(record)
        items = [_ITEM.unpack_from(record, _LASZIP_HEADER.size + _ITEM.size * n) for n in range(count)]
    except struct.error:
        raise MalformedData("LAS: the record of the compression is cut off") from None
    if compressor not in (_POINTWISE, _CHUNKED, _LAYERED) or coder != 0:
        raise MalformedData(f"LAS: an unknown compression {compressor}, {coder}")
    if chunk_points == 0 and compressor != _POINTWISE:
        raise MalformedData("LAS: a chunk has no points")
    if not items or sum(length for _, length, _ in items) != point_bytes:
        raise MalformedData(f"LAS: the compression has other points than those of {point_bytes} bytes")
    layered = [version in (3, 4) for _, _, version in items]
    if any(layered) and not (all(layered) and compressor == _LAYERED):
        raise MalformedData("LAS: the compression has items of several kinds")
    layers = sum(length if kind == _EXTRA_BYTES else _LAYERS.get(kind, 0) for kind, length, _ in items)
    return _Packing(compressor, chunk_points, layers if any(layered) else 0, record)


def _check_chunks(
    file: BinaryIO, start: int, size: int, points: int, point_bytes: int, packing: _Packing
) -> None:
    """Compare the table of chunks, and the layers in each, with the file."""
    if packing.compressor == _POINTWISE:
        return
    table = _table_start(file, start, size)
    file.seek(table + 4)
    (chunks,) = struct.unpack("<I", file.read(4))
    data = table - start - 8
    if not 0 < chunks <= min(_MAX_CHUNKS, data // point_bytes):
        raise MalformedData(f"LAS: {data} compressed bytes cannot hold {chunks} chunks")
    if packing.chunk_points != _VARIABLE and chunks != -(-points // packing.chunk_points):
        raise MalformedData(
            f"LAS: {chunks} chunks of {packing.chunk_points} points are not its {points} points"
        )
    if packing.chunk_points != _VARIABLE and chunks * packing.chunk_points > points + _SPARE_POINTS:
        raise MalformedData(f"LAS: chunks of {packing.chunk_points} points for {points} points")
    import lazrs

    file.seek(start)
    try:
        entries = lazrs.read_chunk_table(file, lazrs.LazVlr(packing.record))
    except (KeyboardInterrupt, SystemExit, MemoryError):
        raise
    except BaseException as error:  # a panic of the Rust backend is not an Exception
        raise MalformedData(f"LAS: {str(error) or type(error).__name__}") from error
    if packing.chunk_points == _VARIABLE and (
        sum(count for count, _ in entries) != points or not all(0 <= count <= points for count, _ in entries)
    ):
        raise MalformedData(f"LAS: the chunks do not have its {points} points")
    at = start + 8
    for number, (_, length) in enumerate(entries):
        if length > table - at:
            raise MalformedData(f"LAS: chunk {number} has {length} bytes, and {table - at} are left")
        if packing.layers and length:  # writers may leave an empty chunk at the end
            _check_layers(file, at, length, point_bytes, packing.layers, number)
        at += length


def _check_layers(file: BinaryIO, at: int, length: int, point_bytes: int, layers: int, number: int) -> None:
    """Check the head of a chunk: its first point, the number of points, and the bytes of each layer."""
    head = point_bytes + 4 + 4 * layers
    file.seek(at + point_bytes + 4)
    if head > length or head + sum(struct.unpack(f"<{layers}I", file.read(4 * layers))) > length:
        raise MalformedData(f"LAS: the layers of chunk {number} do not fit into its {length} bytes")


def _table_start(file: BinaryIO, start: int, size: int) -> int:
    """Place of the table of chunks: before the points, or, where a writer could not go back, at the end."""
    for place in (start, size - 8):
        file.seek(place)
        (at,) = struct.unpack("<q", file.read(8).ljust(8, b"\0"))
        if at > start:
            break
    if not start + 8 < at <= size - 8:
        raise MalformedData("LAS: the file is cut off: it has no table of chunks")
    return int(at)

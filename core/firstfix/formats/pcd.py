"""Decoder of PCD, the format of the Point Cloud Library: ascii, binary and binary_compressed.

https://pointclouds.org/documentation/tutorials/pcd_file_format.html
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..errors import MalformedData, UnsupportedFormat
from .file_kind import kind_of
from .point_cloud import Body, Column, Limits, PointCloud, axes_of, with_axes
from .text_mode import undo_text_mode
from .text_table import parse_rows

_MAX_HEADER_BYTES = 65_536
_MAX_FIELDS = 256
_MAX_COUNT = 100_000  # a histogram feature (SHOT, VFH) has some hundreds of numbers
# LZF expands 3 bytes to at most 264 bytes.
_MAX_LZF_RATIO = 88
HEADER_KEYS = {"VERSION", "FIELDS", "COLUMNS", "SIZE", "TYPE", "COUNT", "WIDTH", "HEIGHT", "POINTS"}
_NUMBER_TYPES = {
    (kind, size): np.dtype(f"<{code}{size}")
    for kind, code, sizes in (("F", "f", (4, 8)), ("I", "i", (1, 2, 4, 8)), ("U", "u", (1, 2, 4, 8)))
    for size in sizes
}


@dataclass(frozen=True)
class _Field:
    name: str
    dtype: np.dtype[np.generic]
    count: int


@dataclass(frozen=True)
class _Column:
    dtype: np.dtype[np.generic]
    number: int  # index among the numbers of a point
    offset: int  # bytes before it in a point


@dataclass(frozen=True)
class _Header:
    fields: tuple[_Field, ...]
    points: int
    encoding: str
    body_start: int

    @cached_property
    def record_bytes(self) -> int:
        return sum([field.dtype.itemsize * field.count for field in self.fields])

    @property
    def numbers(self) -> int:
        return sum(field.count for field in self.fields)

    def columns(self) -> dict[str, _Column]:
        """The fields of one number, without padding. Of equal names the first one counts."""
        columns: dict[str, _Column] = {}
        number = offset = 0
        for field in self.fields:
            if field.count == 1 and field.name != "_" and field.name not in columns:
                columns[field.name] = _Column(field.dtype, number, offset)
            number += field.count
            offset += field.dtype.itemsize * field.count
        return columns


def decode_pcd(body: Body, limits: Limits) -> PointCloud:
    """Decode the columns of a PCD file.

    Fields of several numbers (COUNT > 1) and padding (``_``) are skipped. Binary columns keep their type
    and may be read-only views of the body; ascii columns are float64.

    Raises:
        MalformedData: the header or the body contradicts the format, or the file is cut off.
        TooLarge: over the limits.
        UnsupportedFormat: binary_compressed without the lzf package.
    """
    body = memoryview(body)  # its slices are views
    header = _parse_header(body)
    limits.check("PCD", header.points, header.record_bytes)
    if header.encoding != "ascii" and bytes(body[header.body_start - 2 : header.body_start]) == b"\r\n":
        body = _with_plain_body(header, body)
    if header.encoding == "ascii":
        columns = _ascii_columns(header, body, limits)
    elif header.encoding == "binary":
        columns = _record_columns(header, body)
    else:
        columns = _compressed_columns(header, body)
    return PointCloud(with_axes("PCD", columns))


def _with_plain_body(header: _Header, body: memoryview) -> memoryview:
    """The file with its body as it was before a text-mode transfer, if it went through one.

    Raises:
        MalformedData: it did, and the body cannot be mended.
    """
    found = body[header.body_start :]
    if header.encoding == "binary":
        need = header.points * header.record_bytes
    else:
        # the compressed data's own size may be damaged, too
        sizes = (bytes(found[:8]), bytes(found[:16]).replace(b"\r\n", b"\n")[:8])
        whole, mended = (8 + int.from_bytes(size[:4], "little") for size in sizes)
        need = whole if whole == len(found) else mended
    plain = undo_text_mode("PCD", found, need)
    return body if plain is found else memoryview(bytes(body[: header.body_start]) + bytes(plain))


def _parse_header(body: Body) -> _Header:
    head = bytes(body[:_MAX_HEADER_BYTES])
    if not head:
        raise MalformedData("PCD: the file is empty (0 bytes)")
    entries: dict[str, list[str]] = {}
    start = 0
    while "DATA" not in entries:
        end = head.find(b"\n", start)
        if end < 0 and not HEADER_KEYS & set(entries):
            raise MalformedData(f"PCD: the file has no PCD header: it is {kind_of(head)}")
        if end < 0:
            raise MalformedData("PCD: the header has no DATA line, or the file is cut off")
        words = head[start:end].decode("latin-1").split()
        start = end + 1
        if words and not words[0].startswith("#"):
            entries[words[0].upper()] = words[1:]
    encoding = " ".join(entries["DATA"]).lower()
    if encoding not in ("ascii", "binary", "binary_compressed"):
        raise MalformedData(f"PCD: DATA {encoding[:40]!r} is not ascii, binary or binary_compressed")
    fields = _parse_fields(entries)
    axes_of("PCD", [field.name for field in fields if field.count == 1])
    return _Header(fields, _parse_points(entries), encoding, start)


def _parse_fields(entries: dict[str, list[str]]) -> tuple[_Field, ...]:
    names = entries.get("FIELDS") or entries.get("COLUMNS")  # COLUMNS: version 0.5
    if not names or len(names) > _MAX_FIELDS:
        raise MalformedData(f"PCD: FIELDS must have 1 to {_MAX_FIELDS} names")
    sizes = _integers(entries, "SIZE", len(names), "4")
    kinds = entries.get("TYPE", ["F"] * len(names))
    counts = _integers(entries, "COUNT", len(names), "1")
    if len(kinds) != len(names):
        raise MalformedData(f"PCD: {len(names)} FIELDS but {len(kinds)} TYPE")
    fields = []
    for name, size, kind, count in zip(names, sizes, kinds, counts, strict=True):
        dtype = _NUMBER_TYPES.get((kind.upper(), size))
        if dtype is None:
            raise MalformedData(f"PCD: field {name[:40]!r} has the unknown type {kind[:8]!r} of {size} bytes")
        if not 0 < count <= _MAX_COUNT:
            raise MalformedData(f"PCD: field {name[:40]!r} has COUNT {count}")
        fields.append(_Field(name, dtype, count))
    return tuple(fields)


def _parse_points(entries: dict[str, list[str]]) -> int:
    (width,) = _integers(entries, "WIDTH", 1, "0")
    (height,) = _integers(entries, "HEIGHT", 1, "1")
    (points,) = _integers(entries, "POINTS", 1, "-1")
    if points < 0:
        if "WIDTH" not in entries:
            raise MalformedData("PCD: neither POINTS nor WIDTH gives the number of points")
        return width * height
    # Some writers write WIDTH 0 and give the number in POINTS only.
    if width * height not in (0, points):
        raise MalformedData(f"PCD: WIDTH {width} x HEIGHT {height} contradicts POINTS {points}")
    return points


def _integers(entries: dict[str, list[str]], key: str, length: int, default: str) -> list[int]:
    words = entries.get(key, [default] * length)
    if len(words) != length:
        raise MalformedData(f"PCD: {key} has {len(words)} values, not {length}")
    for word in words:
        # Only few digits: int() takes quadratic time for a long number.
        if not (word.isascii() and word.isdigit() and len(word) <= 18) and word != default:
            raise MalformedData(f"PCD: {key} must consist of whole numbers")
    return list(map(int, words))


def _ascii_columns(header: _Header, body: Body, limits: Limits) -> dict[str, Column]:
    limits.check("PCD", header.points, 8 * header.numbers)  # every number becomes a float64
    text = body[header.body_start :]
    if (
        len(text) + 1 < 2 * header.numbers * header.points
    ):  # at least a digit and a separator each; no separator after the last
        raise MalformedData(f"PCD: the file is cut off: {len(text)} bytes for {header.points} points")
    if header.points == 0:
        return {name: np.empty(0) for name in header.columns()}
    rows = parse_rows("PCD", text, max_rows=header.points)
    if rows.shape != (header.points, header.numbers):
        raise MalformedData(
            f"PCD: the header declares {header.points} points of {header.numbers} numbers, "
            f"the file has {rows.shape[0]} of {rows.shape[1]}"
        )
    return {name: rows[:, column.number] for name, column in header.columns().items()}


def _record_columns(header: _Header, body: Body) -> dict[str, Column]:
    """Views of a body that is ordered point by point."""
    need, have = header.points * header.record_bytes, len(body) - header.body_start
    if have < need:
        raise MalformedData(
            f"PCD: the file is cut off: {have} of {need} bytes for {header.points} points "
            f"of {header.record_bytes} bytes"
        )
    columns = header.columns()
    record = np.dtype(
        {
            "names": list(columns),
            "formats": [column.dtype for column in columns.values()],
            "offsets": [column.offset for column in columns.values()],
            "itemsize": header.record_bytes,
        }
    )
    # np.frombuffer refuses an empty buffer, which is the body of a cloud without points.
    records = np.frombuffer(body[header.body_start :], record, header.points) if need else np.empty(0, record)
    return {name: records[name] for name in columns}


def _compressed_columns(header: _Header, body: Body) -> dict[str, Column]:
    """The columns of a body that is ordered field by field and compressed by LZF, after two sizes."""
    start = header.body_start + 8
    if len(body) < start:
        raise MalformedData("PCD: the file is cut off: the sizes of the compressed data are missing")
    packed_bytes, plain_bytes = struct.unpack("<II", body[header.body_start : start])
    need = header.points * header.record_bytes
    if plain_bytes != need:
        raise MalformedData(
            f"PCD: {header.points} points of {header.record_bytes} bytes contradict the {plain_bytes} bytes "
            "that the compressed data claims"
        )
    if len(body) - start < packed_bytes:
        raise MalformedData(
            f"PCD: the file is cut off: {len(body) - start} of {packed_bytes} compressed bytes"
        )
    plain = _lzf_decompress(bytes(body[start : start + packed_bytes]), plain_bytes)
    return {
        name: np.frombuffer(plain, column.dtype, header.points, column.offset * header.points)
        if plain
        else np.empty(0, column.dtype)
        for name, column in header.columns().items()
    }


def _lzf_decompress(packed: bytes, plain_bytes: int) -> bytes:
    if plain_bytes == 0:
        return b""
    if plain_bytes > _MAX_LZF_RATIO * len(packed):
        raise MalformedData(f"PCD: {len(packed)} compressed bytes cannot hold {plain_bytes} bytes")
    try:
        import lzf
    except ImportError as error:
        raise UnsupportedFormat("PCD: binary_compressed needs the package python-neo-lzf") from error
    try:
        plain: bytes | None = lzf.decompress(packed, plain_bytes)
    except ValueError as error:
        raise MalformedData(f"PCD: the compressed data is damaged: {error}") from error
    if plain is None or len(plain) != plain_bytes:
        raise MalformedData("PCD: the compressed data is damaged: its size is not the declared one")
    return plain

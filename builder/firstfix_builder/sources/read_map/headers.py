"""Counts that map files declare, compared with their size before a library takes memory for them.

libE57 also expands what the XML of a file says. trimesh takes memory for every accessor of a GLB file,
whether there are bytes for it or not.
"""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

from firstfix.errors import MalformedData, TooLarge, UnsupportedFormat
from firstfix.formats.ply_header import PlyElement, PlyHeader
from firstfix.formats.point_cloud import MAP_LIMITS

_E57_HEAD = struct.Struct(
    "<8sIIQQQQ"
)  # signature, version, bytes of the file, place and bytes of the XML, page
_PAGE_BYTES, _CHECKSUM_BYTES = 1024, 4
MAX_XML_BYTES = 64 << 20  # of some ten thousand scans


def check_e57(path: Path) -> None:
    """Check the places that a file declares, and that its XML is nothing that grows.

    Raises:
        MalformedData: it is no E57, or cut off, or declares entities.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(_E57_HEAD.size)
        if len(head) < _E57_HEAD.size or not head.startswith(b"ASTM-E57"):
            raise MalformedData("E57: the file does not start with ASTM-E57")
        _, _, _, declared, place, xml_bytes, page_bytes = _E57_HEAD.unpack(head)
        if declared != size:
            raise MalformedData(f"E57: the file is cut off: {size} of {declared} bytes")
        if page_bytes != _PAGE_BYTES:
            raise MalformedData(f"E57: pages of {page_bytes} bytes")
        if place > size or xml_bytes > min(size - place, MAX_XML_BYTES):
            raise MalformedData(f"E57: {xml_bytes} bytes of XML at byte {place} of {size}")
        first = place // _PAGE_BYTES * _PAGE_BYTES
        file.seek(first)
        paged = file.read(place - first + xml_bytes + (xml_bytes // _PAGE_BYTES + 2) * _CHECKSUM_BYTES)
    data = _PAGE_BYTES - _CHECKSUM_BYTES
    pages = [paged[start : start + data] for start in range(0, len(paged), _PAGE_BYTES)]
    xml = b"".join(pages)[place - first :][:xml_bytes]
    if b"<!" in xml.replace(b"<![CDATA[", b"").replace(b"<!--", b""):
        raise MalformedData("E57: its XML declares a type or entities")


def check_points(path: Path, points: int) -> None:
    """Check the number of points of all scans. Each takes a bit at least: x, y and z of all are not equal.

    Raises:
        MalformedData: more than the file has bits.
    """
    size = path.stat().st_size
    if points > 8 * size:
        raise MalformedData(f"E57: the file is cut off: {size} bytes for {points} points")


def check_ply(header: PlyHeader, file_bytes: int) -> None:
    """Compare the counts with the bytes of the whole file.

    Raises:
        MalformedData: the file is too small, however short its lists and numbers are.
    """
    body_bytes = file_bytes - header.body_start
    for element in header.elements:
        row_bytes = 2 * len(element.properties) if header.is_ascii else _least_bytes(element)
        if element.count * row_bytes > body_bytes + 1:  # no separator after the last number
            raise MalformedData(
                f"PLY: the file is cut off: {body_bytes} bytes for {element.count} rows of "
                f"{element.name[:40]!r}"
            )


def _least_bytes(element: PlyElement) -> int:
    """Bytes of a row in a binary file whose lists are empty; a list has its length at least."""
    return sum(1 if prop.is_list else prop.dtype.itemsize for prop in element.properties)


_GLB_HEAD = struct.Struct("<4sIIII")  # magic, version, length; length and kind of the first chunk
_JSON = 0x4E4F534A
_NUMBER_BYTES = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
_NUMBERS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
MAX_RATIO = 200  # of Draco: its accessors have no bytes of their own


def check_glb(path: Path) -> None:
    """Check the sizes that a file declares.

    Raises:
        MalformedData: it is no GLB, or larger inside than its bytes allow.
        TooLarge: over the limits of maps.
        UnsupportedFormat: a part of it lies in another file.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(_GLB_HEAD.size)
        if len(head) < _GLB_HEAD.size:
            raise MalformedData(f"GLB: the file is cut off: {len(head)} bytes of a header")
        magic, _, length, json_bytes, kind = _GLB_HEAD.unpack(head)
        if magic != b"glTF" or kind != _JSON:
            raise MalformedData("GLB: the file does not start with glTF and its JSON")
        if length > size or json_bytes > size - _GLB_HEAD.size:
            raise MalformedData(f"GLB: the file is cut off: {size} of {length} bytes")
        try:
            scene = json.loads(file.read(json_bytes))
            declared = sum(map(_bytes_of, scene.get("accessors", [])))
            elsewhere = [one for one in scene.get("buffers", []) if not _is_inside(one)]
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            raise MalformedData(f"GLB: its JSON is damaged: {str(error) or type(error).__name__}") from None
    if elsewhere:
        raise UnsupportedFormat("GLB: a part of it lies in another file")
    if declared > MAP_LIMITS.max_decoded_bytes:
        raise TooLarge(f"GLB: {declared} bytes, the limit is {MAP_LIMITS.max_decoded_bytes} bytes")
    if declared > MAX_RATIO * size:
        raise MalformedData(f"GLB: {size} bytes cannot hold the {declared} bytes that it declares")


def _bytes_of(accessor: dict[str, Any]) -> int:
    count = accessor["count"]
    if not isinstance(count, int) or count < 0:
        raise ValueError(f"a count of {str(count)[:40]}")
    return count * _NUMBER_BYTES[accessor["componentType"]] * _NUMBERS[accessor["type"]]


def _is_inside(buffer: dict[str, Any]) -> bool:
    uri = buffer.get("uri")
    return uri is None or str(uri).startswith("data:")

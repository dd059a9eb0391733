"""Header and XML of an E57 file: libE57 expands what the XML says, and takes memory for the counts in it."""

from __future__ import annotations

import struct
from pathlib import Path

from firstfix.errors import MalformedData

_HEAD = struct.Struct("<8sIIQQQQ")  # signature, version, bytes of the file, place and bytes of the XML, page
_PAGE_BYTES, _CHECKSUM_BYTES = 1024, 4
MOST_XML_BYTES = 64 << 20  # of some ten thousand scans


def check_e57(path: Path) -> None:
    """Checks the places that a file declares, and that its XML is nothing that grows.

    Raises:
        MalformedData: it is no E57, or cut off, or declares entities.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(_HEAD.size)
        if len(head) < _HEAD.size or not head.startswith(b"ASTM-E57"):
            raise MalformedData("E57: the file does not start with ASTM-E57")
        _, _, _, declared, place, xml_bytes, page_bytes = _HEAD.unpack(head)
        if declared != size:
            raise MalformedData(f"E57: the file is cut off: {size} of {declared} bytes")
        if page_bytes != _PAGE_BYTES:
            raise MalformedData(f"E57: pages of {page_bytes} bytes")
        if place > size or xml_bytes > min(size - place, MOST_XML_BYTES):
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
    """Checks the number of points of all scans. Each takes a bit at least: x, y and z of all are not equal.

    Raises:
        MalformedData: more than the file has bits.
    """
    size = path.stat().st_size
    if points > 8 * size:
        raise MalformedData(f"E57: the file is cut off: {size} bytes for {points} points")

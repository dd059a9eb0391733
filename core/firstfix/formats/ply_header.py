"""Parser of the PLY header: elements, their properties and number formats."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import MalformedData
from .file_kind import kind_of
from .point_cloud import Body

_MAX_HEADER_BYTES = 65_536
_MAX_ELEMENTS = 64
_MAX_PROPERTIES = 512
_NAMES_OF_TYPE = {
    "i1": ("char", "int8"),
    "u1": ("uchar", "uint8"),
    "i2": ("short", "int16"),
    "u2": ("ushort", "uint16"),
    "i4": ("int", "int32"),
    "u4": ("uint", "uint32"),
    "i8": ("int64",),
    "u8": ("uint64",),
    "f4": ("float", "float32"),
    "f8": ("double", "float64"),
}
_TYPES = {name: code for code, names in _NAMES_OF_TYPE.items() for name in names}
# Byte order of numbers; None for text.
_ENCODINGS = {"ascii": None, "binary_little_endian": "<", "binary_big_endian": ">"}


@dataclass(frozen=True)
class PlyProperty:
    """A property of an element: one number, or a list of numbers."""

    name: str
    dtype: np.dtype[np.generic]
    is_list: bool


@dataclass(frozen=True)
class PlyElement:
    """A kind of rows, such as vertices or faces."""

    name: str
    count: int
    properties: tuple[PlyProperty, ...]

    @property
    def has_list(self) -> bool:
        """True if a property is a list, so that rows have different lengths."""
        return any(prop.is_list for prop in self.properties)

    @property
    def record(self) -> np.dtype[np.void]:
        """Layout of a row without lists. Of two properties with one name, the first one counts."""
        names, formats, offsets, offset = [], [], [], 0
        for prop in self.properties:
            if prop.name not in names:
                names.append(prop.name)
                formats.append(prop.dtype)
                offsets.append(offset)
            offset += prop.dtype.itemsize
        return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": offset})


@dataclass(frozen=True)
class PlyHeader:
    """The header of a PLY file.

    Attributes:
        is_ascii: text; otherwise binary in the byte order of the dtypes.
        elements: in the order of the file.
        body_start: offset in bytes of the first row.
    """

    is_ascii: bool
    elements: tuple[PlyElement, ...]
    body_start: int

    def count_of(self, element_name: str) -> int:
        """The number of rows of an element; 0 if there is no such element."""
        return sum(element.count for element in self.elements if element.name == element_name)


def parse_ply_header(body: Body) -> PlyHeader:
    """Parse the header.

    Raises:
        MalformedData: not a PLY header of at most 64 KiB.
    """
    head = bytes(body[:_MAX_HEADER_BYTES])
    if not head:
        raise MalformedData("PLY: the file is empty (0 bytes)")
    if head.split(b"\n", 1)[0].strip() != b"ply":
        raise MalformedData(f"PLY: the file does not start with 'ply': it is {kind_of(head)}")
    byte_order: str | None = ""
    elements: list[tuple[str, int, list[PlyProperty]]] = []
    start = head.find(b"\n") + 1
    while True:
        end = head.find(b"\n", start) if start else -1
        if end < 0:
            raise MalformedData("PLY: the header has no end_header, or the file is cut off")
        words = head[start:end].decode("latin-1").split()
        start = end + 1
        if words[:1] == ["end_header"]:
            break
        if not words or words[0] in ("comment", "obj_info"):
            continue
        if words[0] == "format" and len(words) == 3 and words[1] in _ENCODINGS:
            byte_order = _ENCODINGS[words[1]]
        elif words[0] == "element" and len(words) == 3 and len(elements) < _MAX_ELEMENTS:
            elements.append((words[1], _count(words[2]), []))
        elif words[0] == "property" and byte_order == "":
            raise MalformedData("PLY: a property comes before its format")
        elif words[0] == "property" and elements and len(elements[-1][2]) < _MAX_PROPERTIES:
            elements[-1][2].append(_property(words, byte_order))
        else:
            raise MalformedData(f"PLY: the header line {' '.join(words)[:60]!r} cannot be read")
    if byte_order == "":
        raise MalformedData("PLY: the header names no format")
    made = tuple(PlyElement(name, count, tuple(properties)) for name, count, properties in elements)
    return PlyHeader(byte_order is None, made, start)


def _count(word: str) -> int:
    # Only few digits: int() takes quadratic time for a long number.
    if not (word.isascii() and word.isdigit() and len(word) <= 18):
        raise MalformedData(f"PLY: {word[:40]!r} is not an element count")
    return int(word)


def _property(words: list[str], byte_order: str | None) -> PlyProperty:
    is_list = words[1:2] == ["list"]
    types = words[2:4] if is_list else words[1:2]
    if len(words) != len(types) + (3 if is_list else 2) or any(name not in _TYPES for name in types):
        raise MalformedData(f"PLY: the header line {' '.join(words)[:60]!r} cannot be read")
    return PlyProperty(words[-1], np.dtype((byte_order or "<") + _TYPES[types[-1]]), is_list)

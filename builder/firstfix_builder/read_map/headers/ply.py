"""Counts of rows in the header of a PLY file."""

from __future__ import annotations

from firstfix.errors import MalformedData
from firstfix.formats.ply_header import PlyElement, PlyHeader


def check_ply(header: PlyHeader, file_bytes: int) -> None:
    """Compares the counts with the bytes of the whole file.

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

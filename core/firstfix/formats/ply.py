"""Decoder of the vertices of PLY, ascii or binary in both byte orders. Other elements are skipped."""

from __future__ import annotations

import numpy as np

from ..errors import MalformedData, UnsupportedFormat
from .ply_header import PlyElement, PlyHeader, parse_ply_header
from .point_cloud import Body, Column, Limits, PointCloud, axes_of, with_axes
from .text_mode import undo_text_mode
from .text_table import parse_rows


def decode_ply(body: Body, limits: Limits) -> PointCloud:
    """Decode the columns of the vertices of a PLY file.

    Binary columns keep their type and may be read-only views of the body; ascii columns are float64.

    Raises:
        MalformedData: the header or the body contradicts the format, or the file is cut off.
        TooLarge: over the limits.
        UnsupportedFormat: a binary file has lists (faces) before or in the vertices.
    """
    body = memoryview(body)  # its slices are views
    header = parse_ply_header(body)
    vertices = next((element for element in header.elements if element.name == "vertex"), None)
    if vertices is None:
        raise MalformedData("PLY: the file has no element 'vertex'")
    axes_of("PLY", [prop.name for prop in vertices.properties if not prop.is_list])
    if vertices.has_list:
        raise UnsupportedFormat("PLY: vertices with list properties are not supported")
    before = header.elements[: header.elements.index(vertices)]
    limits.check("PLY", vertices.count, 8 * len(vertices.properties))
    rows = body[header.body_start :]
    has_crlf = bytes(body[header.body_start - 2 : header.body_start]) == b"\r\n"
    if has_crlf and not header.is_ascii:
        sizes = [element.count * element.record.itemsize for element in header.elements]
        has_lists = any(element.has_list for element in header.elements)
        rows = undo_text_mode("PLY", rows, None if has_lists else sum(sizes))
    decode = _ascii_columns if header.is_ascii else _binary_columns
    return PointCloud(with_axes("PLY", decode(header, before, vertices, rows)))


def _binary_columns(
    header: PlyHeader, before: tuple[PlyElement, ...], vertices: PlyElement, body: memoryview
) -> dict[str, Column]:
    if any(element.has_list and element.count for element in before):
        raise UnsupportedFormat("PLY: elements with lists (faces) before the vertices are not supported")
    start = sum(element.count * element.record.itemsize for element in before if not element.has_list)
    record = vertices.record
    need, have = vertices.count * record.itemsize, max(0, len(body) - start)
    if have < need:
        raise MalformedData(
            f"PLY: the file is cut off: {have} of {need} bytes for {vertices.count} vertices "
            f"of {record.itemsize} bytes"
        )
    rows = np.frombuffer(body[start:], record, vertices.count) if need else np.empty(0, record)
    return {name: rows[name] for name in record.names or ()}


def _ascii_columns(
    header: PlyHeader, before: tuple[PlyElement, ...], vertices: PlyElement, body: memoryview
) -> dict[str, Column]:
    numbers = len(vertices.properties)
    if (
        len(body) + 1 < 2 * numbers * vertices.count
    ):  # at least a digit and a separator each; no separator after the last
        raise MalformedData(f"PLY: the file is cut off: {len(body)} bytes for {vertices.count} vertices")
    names = vertices.record.names or ()
    if vertices.count == 0:
        return {name: np.empty(0) for name in names}
    text = _after_lines(body, sum(element.count for element in before))
    rows = parse_rows("PLY", text, max_rows=vertices.count)
    if rows.shape != (vertices.count, numbers):
        raise MalformedData(
            f"PLY: the header declares {vertices.count} vertices of {numbers} numbers, "
            f"the file has {rows.shape[0]} of {rows.shape[1]}"
        )
    first = {prop.name: column for column, prop in reversed(list(enumerate(vertices.properties)))}
    return {name: rows[:, first[name]] for name in names}


def _after_lines(body: memoryview, lines: int) -> memoryview:
    if lines == 0:
        return body
    ends = np.flatnonzero(np.frombuffer(body, np.uint8) == ord("\n"))
    if len(ends) < lines:
        raise MalformedData("PLY: the lines before the vertices are cut off")
    return body[int(ends[lines - 1]) + 1 :]

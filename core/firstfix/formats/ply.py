"""The vertices of PLY, ascii or binary of both byte orders. Other elements are stepped over."""

from __future__ import annotations

import numpy as np

from ..errors import MalformedData, UnsupportedFormat
from .ply_header import PlyElement, PlyHeader, parse_ply_header
from .point_cloud import Body, Column, Limits, PointCloud, require_xyz
from .text_table import parse_rows


def decode_ply(body: Body, limits: Limits) -> PointCloud:
    """A PLY file's bytes to the columns of its vertices.

    Binary columns keep their type and may be read-only views of the body; ascii ones are float64.

    Raises:
        MalformedData: the header or the body contradicts the format, or the file is cut off.
        TooLarge: over the limits.
        UnsupportedFormat: lists (faces) stand before or in the vertices of a binary file.
    """
    body = memoryview(body)  # its slices are views
    header = parse_ply_header(body)
    vertices = next((element for element in header.elements if element.name == "vertex"), None)
    if vertices is None:
        raise MalformedData("PLY: there is no element 'vertex'")
    require_xyz("PLY", {prop.name for prop in vertices.properties if not prop.is_list})
    if vertices.has_list:
        raise UnsupportedFormat("PLY: vertices with list properties are not read")
    before = header.elements[: header.elements.index(vertices)]
    limits.check("PLY", vertices.count, 8 * len(vertices.properties))
    decode = _ascii_columns if header.is_ascii else _binary_columns
    return PointCloud(decode(header, before, vertices, body[header.body_start :]))


def _binary_columns(
    header: PlyHeader, before: tuple[PlyElement, ...], vertices: PlyElement, body: memoryview
) -> dict[str, Column]:
    if any(element.has_list and element.count for element in before):
        raise UnsupportedFormat("PLY: elements with lists (faces) before the vertices are not read")
    start = sum(element.count * element.record.itemsize for element in before if not element.has_list)
    record = vertices.record
    need, have = vertices.count * record.itemsize, max(0, len(body) - start)
    if have < need:
        raise MalformedData(
            f"PLY: {vertices.count} vertices of {record.itemsize} bytes are promised, "
            f"{have} of {need} bytes are there: cut off"
        )
    rows = np.frombuffer(body[start:], record, vertices.count) if need else np.empty(0, record)
    return {name: rows[name] for name in record.names or ()}


def _ascii_columns(
    header: PlyHeader, before: tuple[PlyElement, ...], vertices: PlyElement, body: memoryview
) -> dict[str, Column]:
    numbers = len(vertices.properties)
    if len(body) + 1 < 2 * numbers * vertices.count:  # a digit and a separator each, the last without
        raise MalformedData(f"PLY: {vertices.count} vertices are promised, {len(body)} bytes follow: cut off")
    names = vertices.record.names or ()
    if vertices.count == 0:
        return {name: np.empty(0) for name in names}
    text = _after_lines(body, sum(element.count for element in before))
    rows = parse_rows("PLY", text, max_rows=vertices.count)
    if rows.shape != (vertices.count, numbers):
        raise MalformedData(
            f"PLY: {vertices.count} vertices of {numbers} numbers are promised, "
            f"{rows.shape[0]} of {rows.shape[1]} are there"
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

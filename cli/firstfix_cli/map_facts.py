"""Lines of a check about a map's reading: format, frame, unit, clouds and poses, and what was left out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from firstfix_builder.sources.check_map.shape import Shape
    from firstfix_builder.sources.read_map import MapData

NAMED_CLOUDS = 5


def what_was_read(data: MapData, shape: Shape) -> dict[str, Any]:
    """The facts of a map that was read, ready for JSON; an empty text says that nothing is known."""
    read = data.read
    poses = 0 if data.trajectory is None else len(data.trajectory)
    return {
        "format": read.form,
        "program": read.program,
        "unit": read.unit,
        "georeference": read.georeference,
        "origin_m": data.origin.tolist(),
        "extent_m": shape.extent_m.tolist(),
        "whole_extent_m": shape.whole_m.tolist(),
        "clouds": list(read.clouds),
        "poses": poses,
        "poses_of": read.poses if poses else "",
        "poses_given": bool(poses) and data.trajectory_source == "given",
        "left_out": [one.words for one in read.left_out],
        "notes": list(read.notes),
    }


def read_lines(read: Mapping[str, Any]) -> list[str]:
    """The same as text."""
    by = f", written by {read['program']}" if read["program"] else ""
    clouds, count = read["clouds"], len(read["clouds"])
    named = ", ".join(clouds[:NAMED_CLOUDS]) + (
        f" and {count - NAMED_CLOUDS} more" if count > NAMED_CLOUDS else ""
    )
    source = "given" if read["poses_given"] else "of the map itself"
    of = f" of {read['poses_of']}" if read["poses_of"] else ""
    x, y, _ = read["origin_m"]
    return [
        *([f"format: {read['format'] or 'unknown'}{by}"] if read["format"] or by else []),
        *([f"unit: {read['unit']}"] if read["unit"] else []),
        *([f"frame: {read['georeference']}"] if read["georeference"] else []),
        *([f"frame: large coordinates, around ({x:,.0f}, {y:,.0f})"] if x or y else []),
        *([f"clouds: {named}"] if clouds else []),
        f"poses: {read['poses']:,}{of}, {source}" if read["poses"] else "poses: none",
        *read["left_out"],
        *read["notes"],
    ]

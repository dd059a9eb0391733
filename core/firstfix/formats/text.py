"""Decoder of points as text: XYZ, TXT, CSV, and PTS with its first line, the number of points."""

from __future__ import annotations

import re
from dataclasses import dataclass

from ..errors import MalformedData, TooLarge
from .point_cloud import INTENSITY_NAMES, RING_NAMES, Body, Limits, PointCloud, axes_of
from .point_times import is_time_name
from .text_table import is_number, parse_rows

_SNIFFED_BYTES = 65_536
_KEPT = {"x", "y", "z", *INTENSITY_NAMES, *RING_NAMES}
_UNIT = re.compile(r"\([^()]*\)")  # RANGE (mm); one look at each character, as names may be 64 KiB long
_OUSTER = {"x1": "x", "y1": "y", "z1": "z", "row": "ring"}  # ouster-cli's names; 1 is the first return
_MAX_UNNAMED_COLUMNS = 10  # x y z, intensity, colour, normal; 12 numbers are a pose


@dataclass(frozen=True)
class _Layout:
    """The layout by the first lines: columns, delimiter, number of points and start of the rows."""

    columns: dict[str, int]
    delimiter: str | None
    declared_points: int | None
    start: int


def decode_text(body: Body, limits: Limits) -> PointCloud:
    """Decode rows of numbers, separated by commas, semicolons, tabs or spaces.

    A line of names selects the columns x, y, z, intensity, times and beams in any order. Without such a
    line, the first three columns are x, y, z, and the fourth of 4 or 7 (PTS) is the intensity. Lines that
    start with ``#`` or ``//`` are comments, unless they name x, y and z, or x1, y1 and z1 as ouster-cli does.
    A first line of one whole number is the number of points (PTS).

    Raises:
        MalformedData: no rows of three numbers, or another number of rows than declared.
        TooLarge: over the limits.
    """
    raw = bytes(body)
    layout = _sniff(raw)
    # The number of lines, before any line is parsed.
    limits.check("text", raw.count(b"\n", layout.start), 8 * len(layout.columns))
    rows = parse_rows(
        "text",
        memoryview(raw)[layout.start :],
        columns=tuple(layout.columns.values()),
        delimiter=layout.delimiter,
        comments="#",
    )
    if rows.shape[0] > limits.max_points:
        raise TooLarge(f"text: {rows.shape[0]} points, the limit is {limits.max_points}")
    if layout.declared_points not in (None, rows.shape[0]):
        raise MalformedData(f"text: the file is cut off: {rows.shape[0]} of {layout.declared_points} points")
    if not len(rows):
        raise MalformedData("text: the file has no row of numbers")
    return PointCloud({name: rows[:, column] for column, name in enumerate(layout.columns)})


def _sniff(raw: bytes) -> _Layout:
    if not raw:
        raise MalformedData("text: the file is empty (0 bytes)")
    names: list[str] = []
    comment = ""
    declared: int | None = None
    start = 3 if raw.startswith(b"\xef\xbb\xbf") else 0  # a byte order mark
    while start < min(len(raw), _SNIFFED_BYTES):
        end = raw.find(b"\n", start)
        end = len(raw) if end < 0 else end
        line = raw[start : min(end, start + _SNIFFED_BYTES)].decode("latin-1").strip()
        content = line.lstrip("#/ \t")
        is_comment = content != line
        delimiter = next((mark for mark in ";," if mark in content), None)
        words = [word.strip().strip('"').lower() for word in content.split(delimiter)]
        if is_comment or not line:
            words = _plain(words)
            if {"x", "y", "z"} <= set(words):
                names = words
            comment = line or comment
        elif all(is_number(word) for word in words):
            if len(words) > 1:
                return _Layout(_columns(names, len(words), comment), delimiter, declared, start)
            if declared is not None or not words[0].isdigit() or len(words[0]) > 18:
                raise MalformedData("text: a row has a single number where x, y, z are expected")
            declared = int(words[0])
        elif names or words[0][:1] in set("-.0123456789"):
            why = ": write numbers with a point" if delimiter == ";" and "," in content else ""
            raise MalformedData(f"text: {line[:60]!r} is not a row of numbers{why}")
        else:
            names = _plain(words)
            axes_of(f"text: {line[:60]!r}, the line of names", names)
        start = end + 1
    raise MalformedData("text: the start of the file has no row of numbers")


def _plain(names: list[str]) -> list[str]:
    """The names without units, but for those of times; ouster-cli's under their usual ones."""
    plain = [name if is_time_name(name) else _UNIT.sub("", name).rstrip() for name in names]
    is_ouster = {"x1", "y1", "z1"} <= set(plain) and "x" not in plain
    return [_OUSTER.get(name, name) for name in plain] if is_ouster else plain


def _columns(names: list[str], width: int, comment: str) -> dict[str, int]:
    if names:
        kept = [name for name in dict.fromkeys(names) if name in _KEPT or is_time_name(name)]
        return {name: names.index(name) for name in (*"xyz", *(one for one in kept if one not in "xyz"))}
    if not 3 <= width <= _MAX_UNNAMED_COLUMNS:
        last = f", and not {comment[:60]!r}" if comment else ""
        raise MalformedData(f"text: rows of {width} numbers, without a line that names x, y, z{last}")
    return {"x": 0, "y": 1, "z": 2, **({"intensity": 3} if width in (4, 7) else {})}

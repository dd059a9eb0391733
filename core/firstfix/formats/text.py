"""Points as text: XYZ, TXT, CSV, and PTS with its line of the point count."""

from __future__ import annotations

from dataclasses import dataclass

from ..errors import MalformedData, TooLarge
from .point_cloud import Body, Limits, PointCloud, require_xyz
from .text_table import parse_rows

_SNIFFED_BYTES = 65_536
_MAX_UNNAMED_COLUMNS = 10  # x y z, intensity, colour, normal; 12 are the rows of a pose


@dataclass(frozen=True)
class _Layout:
    """What the first lines say: the columns by name, and where the rows start."""

    columns: dict[str, int]
    delimiter: str | None
    promised_points: int | None
    start: int


def decode_text(body: Body, limits: Limits) -> PointCloud:
    """Rows of numbers, separated by commas, semicolons, tabs or spaces.

    A line of names picks the columns x, y, z and intensity in any order; without one the first three
    columns are x, y, z, and the fourth of 4 or 7 (PTS) is the intensity. Lines that start with ``#`` or
    ``//`` are comments, unless they name x, y and z. A first line of one whole number is PTS's count.

    Raises:
        MalformedData: no rows of three numbers, or not as many as promised.
        TooLarge: over the limits.
    """
    raw = bytes(body)
    layout = _sniff(raw)
    # Counted as lines, before any is parsed.
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
    if layout.promised_points not in (None, rows.shape[0]):
        raise MalformedData(
            f"text: {layout.promised_points} points are promised, {rows.shape[0]} are there: cut off"
        )
    if not len(rows):
        raise MalformedData("text: there is no row of numbers")
    return PointCloud({name: rows[:, column] for column, name in enumerate(layout.columns)})


def _sniff(raw: bytes) -> _Layout:
    if not raw:
        raise MalformedData("text: the file is empty (0 bytes)")
    names: list[str] = []
    promised: int | None = None
    start = 3 if raw.startswith(b"\xef\xbb\xbf") else 0  # a byte order mark
    while start < min(len(raw), _SNIFFED_BYTES):
        end = raw.find(b"\n", start)
        end = len(raw) if end < 0 else end
        line = raw[start : min(end, start + _SNIFFED_BYTES)].decode("latin-1").strip()
        content = line.lstrip("#/ \t")
        is_comment = content != line
        delimiter = next((mark for mark in ",;" if mark in content), None)
        words = [word.strip().strip('"').lower() for word in content.split(delimiter)]
        if is_comment or not line:
            if {"x", "y", "z"} <= set(words):
                names = words
        elif all(_is_number(word) for word in words):
            if len(words) > 1:
                return _Layout(_columns(names, len(words)), delimiter, promised, start)
            if promised is not None or not words[0].isdigit() or len(words[0]) > 18:
                raise MalformedData("text: a row has a single number where x, y, z are expected")
            promised = int(words[0])
        elif names:
            raise MalformedData(f"text: {line[:60]!r} is no row of numbers")
        else:
            names = words
            require_xyz("text: the line of names", set(names))
        start = end + 1
    raise MalformedData("text: there is no row of numbers at its start")


def _columns(names: list[str], width: int) -> dict[str, int]:
    if names:
        return {name: names.index(name) for name in ("x", "y", "z", "intensity") if name in names}
    if not 3 <= width <= _MAX_UNNAMED_COLUMNS:
        raise MalformedData(f"text: rows of {width} numbers, and no line of names says which are x, y, z")
    return {"x": 0, "y": 1, "z": 2, **({"intensity": 3} if width in (4, 7) else {})}


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True

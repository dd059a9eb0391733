"""Decoder of raw little-endian float32 rows without a header: their columns are told."""

from __future__ import annotations

import re

import numpy as np

from ..errors import InvalidOption, MalformedData
from .point_cloud import Body, Limits, PointCloud

SKIPPED = "_"
MAX_COLUMNS = 64
_NAME = re.compile(r"[a-z0-9_]{1,40}")


def decode_xyz(body: Body, limits: Limits) -> PointCloud:
    """Decode rows of 12 bytes.

    Raises:
        MalformedData: empty, or not a whole number of rows.
        TooLarge: over the limits.
    """
    return decode_rows(body, ("x", "y", "z"), limits)


def decode_xyzi(body: Body, limits: Limits) -> PointCloud:
    """Decode rows of 16 bytes.

    Raises:
        MalformedData: empty, or not a whole number of rows.
        TooLarge: over the limits.
    """
    return decode_rows(body, ("x", "y", "z", "intensity"), limits)


def parse_columns(text: str) -> tuple[str, ...]:
    """The names of columns of a text such as ``x,y,z,intensity,ring``. A column ``_`` is left out.

    Raises:
        InvalidOption: not such names, one twice, or no x, y, z.
    """
    names = tuple(name.strip().lower() for name in text.split(","))
    named = [name for name in names if name != SKIPPED]
    if not all(_NAME.fullmatch(name) for name in names) or len(names) > MAX_COLUMNS:
        raise InvalidOption(f"columns are names with commas, as x,y,z,intensity,ring, not {text[:80]!r}")
    if len(set(named)) < len(named) or not {"x", "y", "z"} <= set(named):
        raise InvalidOption(f"columns need x, y and z, and each name once, not {text[:80]!r}")
    return names


def decode_rows(body: Body, names: tuple[str, ...], limits: Limits, *, by_column: bool = False) -> PointCloud:
    """Decode rows of float32 numbers with these columns.

    Args:
        names: of the columns, x, y and z among them; ``_`` is left out.
        by_column: all numbers of a column stand together, in place of those of a row.

    Raises:
        MalformedData: empty, or not a whole number of rows.
        TooLarge: over the limits.
    """
    format_name, row_bytes = f"raw {' '.join(names)}", 4 * len(names)
    if not len(body):
        raise MalformedData(f"{format_name}: the data is empty (0 bytes)")
    if len(body) % row_bytes:
        raise MalformedData(
            f"{format_name}: {len(body)} bytes are not a whole number of rows of {row_bytes} bytes"
        )
    limits.check(format_name, len(body) // row_bytes, row_bytes)
    numbers = np.frombuffer(body, "<f4")
    rows = numbers.reshape(len(names), -1).T if by_column else numbers.reshape(-1, len(names))
    return PointCloud({name: rows[:, column] for column, name in enumerate(names) if name != SKIPPED})

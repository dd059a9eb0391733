"""Parser of rows of numbers for ascii PCD, ascii PLY, XYZ, PTS and CSV."""

from __future__ import annotations

import io
import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..errors import MalformedData
from .point_cloud import Body

_EMPTY_LINES = re.compile(rb"\n\s+")
_NO_NUMBER = re.compile(r"could not convert string ('.*') to \w+ at row (\d+)")
MAX_LINE_BYTES = 65_536  # the parser is slow for lines with thousands of columns


def parse_rows(
    format_name: str,
    text: Body,
    *,
    columns: Sequence[int] | None = None,
    delimiter: str | None = None,
    comments: str | None = None,
    max_rows: int | None = None,
) -> NDArray[np.float64]:
    """Parses rows of numbers. All rows have the same length. Empty lines are skipped.

    Args:
        columns: columns to keep, in this order; None: all.
        delimiter: one character, or None for spaces and tabs.
        comments: prefix of comments.
        max_rows: later rows are ignored.

    Returns:
        (rows, columns) float64; (0, 0) if there is no row.

    Raises:
        MalformedData: not text, not numbers, rows of different lengths, or a line over 64 KiB.
    """
    raw = bytes(text)
    if not raw.isascii() or b"\0" in raw:
        raise MalformedData(f"{format_name}: the numbers contain bytes that are not text")
    raw = _EMPTY_LINES.sub(b"\n", raw.lstrip())  # NumPy warns about empty lines
    if not raw:
        return np.empty((0, 0))
    _check_lines(format_name, raw)
    try:
        return np.loadtxt(
            io.BytesIO(raw),
            np.float64,
            comments=comments,
            delimiter=delimiter,
            usecols=columns,
            max_rows=max_rows,
            ndmin=2,
        )
    except (ValueError, IndexError, OverflowError) as error:
        raise MalformedData(f"{format_name}: {_plain(str(error))}") from error


def _plain(reason: str) -> str:
    """The reason without NumPy's words, and without its advice for callers."""
    word = _NO_NUMBER.match(reason)
    if word is None:
        return reason.split(";")[0]
    hint = ": separate the numbers by spaces" if "," in word[1] else ""
    return f"row {int(word[2]) + 1}: {word[1]} is not a number{hint}"


def _check_lines(format_name: str, raw: bytes) -> None:
    ends = np.flatnonzero(np.frombuffer(raw, np.uint8) == ord("\n"))
    longest = int(np.max(np.diff(ends, prepend=-1, append=len(raw))))
    if longest > MAX_LINE_BYTES:
        raise MalformedData(f"{format_name}: a line of {longest} bytes, the limit is {MAX_LINE_BYTES}")

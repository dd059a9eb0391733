"""Rows of numbers in text: the one parser behind ascii PCD, ascii PLY, XYZ, PTS and CSV."""

from __future__ import annotations

import io
import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..errors import MalformedData
from .point_cloud import Body

_EMPTY_LINES = re.compile(rb"\n\s+")
MAX_LINE_BYTES = 65_536  # a line with thousands of columns costs the parser far more than its bytes


def parse_rows(
    format_name: str,
    text: Body,
    *,
    columns: Sequence[int] | None = None,
    delimiter: str | None = None,
    comments: str | None = None,
    max_rows: int | None = None,
) -> NDArray[np.float64]:
    """Numbers in rows, all rows of one length, empty lines skipped.

    Args:
        columns: which to keep, in this order; None: all.
        delimiter: one character, or None for any run of spaces and tabs.
        comments: what starts a comment.
        max_rows: later rows are not looked at.

    Returns:
        (rows, columns) float64; (0, 0) when there is no row.

    Raises:
        MalformedData: not text, not numbers, rows of different length, a line of over 64 KiB.
    """
    raw = bytes(text)
    if not raw.isascii() or b"\0" in raw:
        raise MalformedData(f"{format_name}: bytes that are not text stand among the numbers")
    raw = _EMPTY_LINES.sub(b"\n", raw.lstrip())  # NumPy warns of every empty line when it counts rows
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
        reason = str(error).split(";")[0]  # behind it NumPy advises its own caller
        raise MalformedData(f"{format_name}: {reason}") from error


def _check_lines(format_name: str, raw: bytes) -> None:
    ends = np.flatnonzero(np.frombuffer(raw, np.uint8) == ord("\n"))
    longest = int(np.max(np.diff(ends, prepend=-1, append=len(raw))))
    if longest > MAX_LINE_BYTES:
        raise MalformedData(f"{format_name}: a line of {longest} bytes")

"""Parser of rows of numbers for ascii PCD, ascii PLY, XYZ, PTS and CSV."""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from ..errors import MalformedData
from .point_cloud import Body

_SEARCHED_ROWS = 100_000  # for one that is wrong: Python takes a tenth of a second for them
_DECIMAL_COMMA = re.compile(r"\d,\d")
_WORDS = {" ": "spaces", ",": "commas", ";": "semicolons", "\t": "tabs"}
_EMPTY_LINES = re.compile(rb"\n\s+")
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
        raise MalformedData(f"{format_name}: {_wrong_line(raw, delimiter, comments)}") from error


def _wrong_line(raw: bytes, delimiter: str | None, comments: str | None) -> str:
    """What is wrong with the first line that has not as many numbers as the first one."""
    separator, wanted = delimiter or " ", 0
    for number, one in enumerate(islice(io.BytesIO(raw), _SEARCHED_ROWS), 1):
        line = one.decode("ascii")
        content = (line.split(comments)[0] if comments else line).strip()
        if not content:
            continue
        words = content.split(delimiter)
        wanted = wanted or len(words)
        told = f"row {number} is {line.strip()[:60]!r}"
        if not all(map(is_number, words)):
            if _DECIMAL_COMMA.search(content) and "." not in content:
                return f"{told}: write numbers with a point, and separate them by {_WORDS[separator]}"
            return f"{told}: not numbers separated by {_WORDS[separator]}"
        if len(words) != wanted:
            return f"{told}: {len(words)} numbers where the rows before have {wanted}"
    return "the rows are not of numbers"


def decimal_comma(line: str) -> bool:
    """Returns whether a line has numbers with a comma in place of the point, separated by something else."""
    return ";" in line and _DECIMAL_COMMA.search(line) is not None


def is_number(word: str) -> bool:
    """Returns whether a word is a number, as NumPy reads them."""
    try:
        float(word)
    except ValueError:
        return False
    return "_" not in word


def _check_lines(format_name: str, raw: bytes) -> None:
    ends = np.flatnonzero(np.frombuffer(raw, np.uint8) == ord("\n"))
    longest = int(np.max(np.diff(ends, prepend=-1, append=len(raw))))
    if longest > MAX_LINE_BYTES:
        raise MalformedData(f"{format_name}: a line of {longest} bytes, the limit is {MAX_LINE_BYTES}")

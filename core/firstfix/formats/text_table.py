"""Parser of rows of numbers for ascii PCD, ascii PLY, XYZ, PTS and CSV."""

from __future__ import annotations

import io
import re
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from ..errors import MalformedData
from .point_cloud import Body

_SEARCHED_ROWS = 100_000  # for one that is wrong: Python takes a tenth of a second for them
_WORDS = {None: "spaces", ",": "commas", ";": "semicolons"}
_EMPTY_LINES = re.compile(rb"\n\s+")
PIECE_BYTES = 1 << 20  # NumPy parses so many at once: until it is done, no other thread of the process runs
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
    """Parse rows of numbers. All rows have the same length. Empty lines are skipped.

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
        return _joined(_parsed(raw, columns, delimiter, comments, max_rows))
    except (ValueError, IndexError, OverflowError) as error:
        raise MalformedData(f"{format_name}: {_wrong_line(raw, delimiter, comments)}") from error


def _parsed(
    raw: bytes,
    columns: Sequence[int] | None,
    delimiter: str | None,
    comments: str | None,
    max_rows: int | None,
) -> Iterator[NDArray[np.float64]]:
    """Yield the rows of each piece of whole lines."""
    start = 0
    while start == 0 or (start < len(raw) and max_rows != 0):
        end = raw.find(b"\n", start + PIECE_BYTES - 1) + 1 or len(raw)
        rows = np.loadtxt(
            io.BytesIO(raw[start:end]),
            np.float64,
            comments=comments,
            delimiter=delimiter,
            usecols=columns,
            max_rows=max_rows,
            ndmin=2,
        )
        yield rows
        start = end
        max_rows = None if max_rows is None else max_rows - len(rows)


def _joined(pieces: Iterable[NDArray[np.float64]]) -> NDArray[np.float64]:
    """The rows of all pieces; those without a row, of comments, have no width."""
    found = list(pieces)
    with_rows = [rows for rows in found if len(rows)] or found[:1]
    return with_rows[0] if len(with_rows) == 1 else np.concatenate(with_rows)


def _wrong_line(raw: bytes, delimiter: str | None, comments: str | None) -> str:
    """Fault of the first row that is not as the first one."""
    wanted = 0
    for number, line in enumerate(islice(io.BytesIO(raw), _SEARCHED_ROWS), 1):
        content = (
            line.decode("ascii").split(comments)[0].strip() if comments else line.decode("ascii").strip()
        )
        words = content.split(delimiter) if content else []
        wanted = wanted or len(words)
        if words and not all(map(is_number, words)):
            return f"row {number} is {content[:60]!r}: not numbers separated by {_WORDS[delimiter]}"
        if words and len(words) != wanted:
            return f"row {number} is {content[:60]!r}: {len(words)} numbers, the rows before have {wanted}"
    return "the rows are not of numbers"


def is_number(word: str) -> bool:
    """Whether a word is a number."""
    try:
        float(word)
    except ValueError:
        return False
    return True


def _check_lines(format_name: str, raw: bytes) -> None:
    ends = np.flatnonzero(np.frombuffer(raw, np.uint8) == ord("\n"))
    longest = int(np.max(np.diff(ends, prepend=-1, append=len(raw))))
    if longest > MAX_LINE_BYTES:
        raise MalformedData(f"{format_name}: a line of {longest} bytes, the limit is {MAX_LINE_BYTES}")

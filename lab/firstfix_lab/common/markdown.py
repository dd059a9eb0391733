"""Tables of reports in Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any


def table(header: Sequence[Any], rows: Iterable[Iterable[Any]]) -> list[str]:
    """The lines of a table. None is shown as a dash."""
    return [_line(header), "|" + "---|" * len(header), *map(_line, rows)]


def _line(cells: Iterable[Any]) -> str:
    return "| " + " | ".join("-" if cell is None else str(cell) for cell in cells) + " |"

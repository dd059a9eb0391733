"""The figures as a table in Markdown, the worlds side by side."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

SEARCH = ("numbers", "key_10", "key_all", "best_10", "best_40", "key_ms", "compare_ms")
RERANKED = ("best_1", "best_5", "best_10", "rank_ms")
REGISTERED = ("registered", "localize_ms")


def report(figures: Mapping[str, Any]) -> str:
    worlds = {name: rows for name, rows in figures["worlds"].items() if not isinstance(rows, str)}
    if not worlds:
        return "no world is there\n"
    each = list(zip(*(world["rows"] for world in worlds.values()), strict=True))
    parts = [f"Each cell: {' / '.join(worlds)}."]
    for columns in (SEARCH, RERANKED, REGISTERED):
        rows = [row for row in each if all(column in row[0] for column in columns)]
        parts += [_table(rows, columns)] if rows else []
    return "\n\n".join(parts) + "\n"


def _table(rows: Sequence[Sequence[Mapping[str, Any]]], columns: Sequence[str]) -> str:
    header = ("piece", "choice", "key", *columns)
    lines = [_line(header), "|" + "---|" * len(header)]
    for row in rows:
        cells = [" / ".join(f"{world[column]:g}" for world in row) for column in columns]
        lines.append(_line((row[0]["piece"], row[0]["choice"], row[0]["key"], *cells)))
    return "\n".join(lines)


def _line(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cells) + " |"

"""The figures as Markdown: one table a world, and the sum of them all."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from .figures import NEES_MEDIAN

HEADER = (
    "n",
    "0.05 m",
    "0.2 m",
    "0.5 m",
    "0.2 m, 2 deg",
    "of the distinct (n)",
    "aliases recognised as ambiguous",
    "among all 0.2 m",
    "localized / ambiguous / rejected",
    "0.2 m of localized",
    "false accepts",
    "ECE",
    f"NEES ({NEES_MEDIAN})",
    "ms p50 / p95 / p99",
)


def report(figures: Mapping[str, Any]) -> str:
    parts = []
    for name, world in figures["worlds"].items():
        if isinstance(world, str):
            parts.append(f"### {name}\n\n{world}\n")
            continue
        built = ", ".join(f"{count} {sensor}" for sensor, count in world["templates"].items())
        parts.append(_table(f"{name} (templates: {built})", "case", world["cases"]))
    parts.append(_table("All worlds", "worlds", figures["total"]))
    return "\n".join(parts)


def _table(title: str, first: str, rows: Mapping[str, Mapping[str, Any]]) -> str:
    lines = [f"### {title}", "", _line((first, *HEADER)), "|" + "---|" * (len(HEADER) + 1)]
    lines += [_line((name, *_cells(row))) for name, row in rows.items()]
    return "\n".join(lines) + "\n"


def _cells(row: Mapping[str, Any]) -> tuple[Any, ...]:
    return (
        row["n"],
        row["success_0.05m"],
        row["success_0.2m"],
        row["success_0.5m"],
        row["success_0.2m_2deg"],
        None if row["distinct_0.2m_2deg"] is None else f"{row['distinct_0.2m_2deg']} ({row['distinct']})",
        row["aliases_recognised"],
        row["among_all_0.2m"],
        " / ".join(str(count) for count in row["verdicts"].values()),
        row["right_localized"],
        row["false_accepts"],
        row["ece"],
        row["nees_median"],
        " / ".join(f"{ms:.0f}" for ms in row["ms"].values()),
    )


def _line(cells: Iterable[Any]) -> str:
    return "| " + " | ".join("-" if cell is None else str(cell) for cell in cells) + " |"
